//! Drawings of an experiment, as SVG. Series differ in stroke, marker or hatching as well as in colour, for print and for
//! colour-blind readers.

use anyhow::Context as _;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::record::short;

/// Size of a drawing.
const SIZE: (u32, u32) = (760, 420);
/// Okabe and Ito's colours.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
];
/// Strokes of curves: length and gap of the dashes; none is a whole line.
const DASHES: [Option<[i32; 2]>; 4] = [None, Some([9, 5]), Some([2, 4]), Some([14, 3])];
/// Letters of a group's name that are written upwards.
const LONGEST_NAME: usize = 28;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Every other series of bars is light.
fn shade(index: usize) -> f64 {
    if index.is_multiple_of(2) { 1.0 } else { 0.35 }
}

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Its heading.
    pub title: String,
    /// What the horizontal axis is.
    pub x_label: String,
    /// What the vertical axis is.
    pub y_label: String,
    /// Names of the groups of bars; no names for curves and lines.
    pub groups: Vec<String>,
    /// Whether each point has a marker.
    pub markers: bool,
    /// What is compared.
    pub series: Vec<Series>,
}

/// One series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Its points in order.
    pub points: Vec<Point>,
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

impl Drawing {
    /// As the text of an SVG file.
    ///
    /// # Errors
    /// If it has no points.
    pub fn svg(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        self.paint(&area).context("cannot draw the figure")?;
        drop(area);
        Ok(text)
    }

    fn range(&self) -> Option<([f64; 2], [f64; 2])> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let ends = |points: &mut dyn Iterator<Item = f64>| {
            points.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
                [low.min(value), high.max(value)]
            })
        };
        let mut x = ends(&mut points().map(|point| point.x));
        if !self.groups.is_empty() {
            x = [-0.5, self.groups.len() as f64 - 0.5];
        }
        let all = |point: &Point| {
            [point.y, point.interval.map_or(point.y, |i| i[0]), point.interval.map_or(point.y, |i| i[1])]
        };
        let [low, high] = ends(&mut points().flat_map(all));
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

    fn paint(&self, area: &Area<'_>) -> anyhow::Result<()> {
        let (x, y) = self.range().context("there is nothing to draw")?;
        let font = |size: u32| ("sans-serif", size).into_font();
        area.fill(&WHITE)?;
        let long = self.groups.iter().any(|name| name.chars().count() * self.groups.len() > 90);
        // The legend goes between the title and the axes.
        let legend = if self.series.len() > 1 { 14 } else { 0 };
        let titled = area.margin(8, 0, 0, 0).titled(&self.title, font(15))?;
        let below = titled.margin(legend, 0, 0, 0);
        let mut chart = ChartBuilder::on(&below)
            .margin(10)
            // The last label is as wide on both sides of its tick.
            .margin_right(22)
            .x_label_area_size(if long { 160 } else { 44 })
            .y_label_area_size(56)
            .build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
        let group = |at: f64| self.groups.get(at.round() as usize).filter(|_| (at - at.round()).abs() < 1e-6);
        let label = |at: &f64| match self.groups.as_slice() {
            [] => number(*at),
            _ => group(*at).cloned().unwrap_or_default(),
        };
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(226, 226, 226))
            .label_style(font(12))
            .axis_desc_style(font(12))
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_label_formatter(&label)
            .y_label_formatter(&|at| number(*at));
        if !self.groups.is_empty() {
            mesh.disable_x_mesh().x_labels(4 * self.groups.len());
        }
        if long {
            mesh.x_labels(0);
        }
        mesh.draw()?;
        if long {
            self.names_upwards(area, &chart, y[0])?;
        }
        for (index, series) in self.series.iter().enumerate() {
            if self.groups.is_empty() {
                self.curve(&mut chart, index, series)?;
            } else {
                self.bars(&chart, index, series)?;
            }
        }
        if self.series.len() > 1 {
            self.legend(area)?;
        }
        Ok(area.present()?)
    }

    /// Names of groups that are too many to stand side by side: each is written upwards below its bars.
    fn names_upwards(&self, area: &Area<'_>, chart: &Chart<'_, '_>, bottom: f64) -> anyhow::Result<()> {
        let font = ("sans-serif", 11).into_font().transform(FontTransform::Rotate270);
        let style = font.into_text_style(area).pos(Pos::new(HPos::Right, VPos::Top));
        for (index, name) in self.groups.iter().enumerate() {
            let (at_x, at_y) = chart.plotting_area().map_coordinate(&(index as f64, bottom));
            let short: String = name.chars().take(LONGEST_NAME).collect();
            area.draw_text(&short, &style, (at_x - 7, at_y + 8))?;
        }
        Ok(())
    }

    fn curve(&self, chart: &mut Chart<'_, '_>, index: usize, series: &Series) -> anyhow::Result<()> {
        let colour = COLOURS[index % COLOURS.len()];
        let band: Vec<(f64, [f64; 2])> =
            series.points.iter().filter_map(|point| Some((point.x, point.interval?))).collect();
        if band.len() > 1 {
            let upper = band.iter().map(|(x, [_, high])| (*x, *high));
            let lower = band.iter().rev().map(|(x, [low, _])| (*x, *low));
            let outline: Vec<(f64, f64)> = upper.chain(lower).collect();
            chart.draw_series([Polygon::new(outline, colour.mix(0.15))])?;
        }
        let points = || series.points.iter().map(|point| (point.x, point.y));
        let style = colour.stroke_width(2);
        match DASHES[index % DASHES.len()] {
            None => chart.draw_series(LineSeries::new(points(), style))?,
            Some([dash, gap]) => chart.draw_series(DashedLineSeries::new(points(), dash, gap, style))?,
        };
        if self.markers {
            let full = colour.filled();
            match index % 3 {
                0 => chart.draw_series(points().map(|at| Circle::new(at, 4, full)))?,
                1 => chart.draw_series(points().map(|at| TriangleMarker::new(at, 4, full)))?,
                _ => chart.draw_series(points().map(|at| Cross::new(at, 4, style)))?,
            };
        }
        Ok(())
    }

    fn bars(&self, chart: &Chart<'_, '_>, index: usize, series: &Series) -> anyhow::Result<()> {
        let colour = COLOURS[index % COLOURS.len()];
        let plot = chart.plotting_area();
        let wide = 0.8 / self.series.len().max(1) as f64;
        for point in &series.points {
            let left = point.x - 0.4 + wide * index as f64;
            let right = left + 0.92 * wide;
            let bar = [(left, 0.0), (right, point.y)];
            plot.draw(&Rectangle::new(bar, colour.mix(shade(index)).filled()))?;
            plot.draw(&Rectangle::new(bar, colour.stroke_width(1)))?;
            let Some([low, high]) = point.interval else { continue };
            let middle = 0.5 * (left + right);
            let end = |at: f64| vec![(middle - 0.2 * wide, at), (middle + 0.2 * wide, at)];
            for line in [vec![(middle, low), (middle, high)], end(low), end(high)] {
                plot.draw(&PathElement::new(line, BLACK.stroke_width(1)))?;
            }
        }
        Ok(())
    }

    /// Names of the series in one line under the heading, with their strokes.
    fn legend(&self, area: &Area<'_>) -> anyhow::Result<()> {
        let style = ("sans-serif", 12).into_font().into_text_style(area);
        let right = area.dim_in_pixel().0 as i32;
        let [mut x, mut y] = [76, 33];
        for (index, series) in self.series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let wide = area.estimate_text_size(&series.name, &style)?.0 as i32 + 46;
            if x + wide > right {
                [x, y] = [76, y + 16];
            }
            let backdrop = [(x - 4, y - 8), (x + wide - 8, y + 7)];
            area.draw(&Rectangle::new(backdrop, WHITE.mix(0.8).filled()))?;
            if self.groups.is_empty() {
                let [dash, gap] = DASHES[index % DASHES.len()].unwrap_or([22, 1]);
                for at in (x..x + 22).step_by((dash + gap) as usize) {
                    let stroke = vec![(at, y), ((at + dash).min(x + 22), y)];
                    area.draw(&PathElement::new(stroke, colour.stroke_width(2)))?;
                }
            } else {
                let patch = [(x + 4, y - 5), (x + 18, y + 5)];
                area.draw(&Rectangle::new(patch, colour.mix(shade(index)).filled()))?;
                area.draw(&Rectangle::new(patch, colour.stroke_width(1)))?;
            }
            area.draw_text(&series.name, &style, (x + 28, y - 5))?;
            x += wide;
        }
        Ok(())
    }
}

/// A number in few characters: `0.5`, `200k`, `3M`.
fn number(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => short(value / 1e6, 3) + "M",
        size if size >= 1e4 => short(value / 1e3, 3) + "k",
        _ => short(value, 3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing(groups: &[&str]) -> Drawing {
        let points = (0..3)
            .map(|i| Point {
                x: f64::from(i),
                y: 0.3 * f64::from(i),
                interval: Some([0.2 * f64::from(i), 0.4]),
            })
            .collect::<Vec<_>>();
        let series =
            ["F1, twin", "a <b> & c"].map(|name| Series { name: name.to_string(), points: points.clone() });
        Drawing {
            title: "What & why".to_string(),
            groups: groups.iter().map(ToString::to_string).collect(),
            markers: true,
            series: series.to_vec(),
            ..Drawing::default()
        }
    }

    #[test]
    fn drawings_come_as_svg() {
        for groups in [&[][..], &["one", "two", "three"]] {
            let drawing = drawing(groups);
            let svg = drawing.svg().unwrap();
            assert!(svg.contains("<svg") && svg.contains("F1, twin"), "{svg}");
            assert!(svg.contains("a &lt;b&gt; &amp; c"), "{svg}");
            assert!(groups.iter().all(|name| svg.contains(name)), "{svg}");
            assert_eq!(drawing.svg().unwrap(), svg);
        }
        assert!(Drawing::default().svg().is_err());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.25, 200_000.0, 3e6, 0.0].map(number), ["0.25", "200k", "3M", "0"]);
    }
}
