//! What a drawing shows.

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Its heading.
    pub title: String,
    /// What the horizontal axis is, with its unit.
    pub x_label: String,
    /// What the vertical axis is, with its unit.
    pub y_label: String,
    /// Names of the groups of bars; no names for curves and lines.
    pub groups: Vec<String>,
    /// Whether each point has a marker.
    pub markers: bool,
    /// What is compared.
    pub series: Vec<Series>,
    /// What the marks are, for the legend.
    pub marks: String,
}

/// One series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Its points in order.
    pub points: Vec<Point>,
    /// Values that it is compared with.
    pub marks: Vec<Mark>,
}

/// One point: for bars `x` is the number of its group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Place on the horizontal axis.
    pub x: f64,
    /// Value.
    pub y: f64,
    /// Its interval, if it has one.
    pub interval: Option<[f64; 2]>,
}

/// A value that is not ours, beside a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// Place on the horizontal axis; none for a line across the axes.
    pub x: Option<f64>,
    /// Value.
    pub y: f64,
}

impl Drawing {
    fn has_marks(&self) -> bool {
        self.series.iter().any(|series| !series.marks.is_empty())
    }

    /// Names in the legend, which a single series does not need.
    pub(super) fn legend_names(&self) -> Vec<&str> {
        let names = self.series.iter().map(|series| series.name.as_str());
        let marks = self.has_marks().then_some(self.marks.as_str());
        let all: Vec<&str> = names.chain(marks).collect();
        if all.len() > 1 { all } else { Vec::new() }
    }

    pub(super) fn range(&self) -> Option<([f64; 2], [f64; 2])> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let marks = || self.series.iter().flat_map(|series| &series.marks);
        let ends = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
                [low.min(value), high.max(value)]
            })
        };
        let mut x = ends(&mut points().map(|point| point.x).chain(marks().filter_map(|mark| mark.x)));
        if !self.groups.is_empty() {
            x = [-0.5, self.groups.len() as f64 - 0.5];
        }
        let all = |point: &Point| {
            [point.y, point.interval.map_or(point.y, |i| i[0]), point.interval.map_or(point.y, |i| i[1])]
        };
        let [low, high] = ends(&mut points().flat_map(all).chain(marks().map(|mark| mark.y)));
        if !(x[0].is_finite() && low.is_finite() && high.is_finite()) {
            return None;
        }
        if x[0] == x[1] {
            x = [x[0] - 0.5, x[1] + 0.5];
        }
        // Scores are shown on their whole scale.
        let top = if high <= 1.0 && high > 0.25 { 1.0 } else { high.max(1e-9) * 1.08 };
        let bottom = if low < 0.0 { low * 1.08 } else { 0.0 };
        Some((x, [bottom, top]))
    }
}
