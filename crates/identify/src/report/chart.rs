//! Axes and curves as SVG: as little as an overlay of three curves needs.

use std::fmt::Write as _;

use super::html::escape;
use super::number::number;

/// About so many lines of a grid.
const LINES: f64 = 4.0;
/// More are never drawn.
const MOST_LINES: usize = 12;

/// A rectangle of the drawing, in its units, and what its sides stand for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Left and right.
    pub x: [f64; 2],
    /// Lower and upper side: the second is the smaller number.
    pub y: [f64; 2],
    /// Time at the left and at the right, s.
    pub time: [f64; 2],
    /// Value at the lower and at the upper side.
    pub value: [f64; 2],
}

impl Frame {
    fn place(&self, secs: f64, value: f64) -> (f64, f64) {
        let along = |[from, to]: [f64; 2], at: f64| if to > from { (at - from) / (to - from) } else { 0.5 };
        let across = along(self.value, value.clamp(self.value[0], self.value[1]));
        (
            self.x[0] + along(self.time, secs) * (self.x[1] - self.x[0]),
            self.y[0] + across * (self.y[1] - self.y[0]),
        )
    }

    /// Grid, labels of the values, and of the times where `times` says so.
    pub fn axes(&self, unit: &str, times: bool, out: &mut String) {
        // Writing to a string cannot fail, here and below.
        for value in lines(self.value) {
            let (_, y) = self.place(self.time[0], value);
            let [left, right] = self.x;
            let _ = write!(out, "<path class=\"grid\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>");
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 4.0,
                y + 4.0,
                number(value)
            );
        }
        for secs in lines(self.time) {
            let (x, _) = self.place(secs, self.value[0]);
            let [low, high] = self.y;
            let _ = write!(out, "<path class=\"grid\" d=\"M{x:.1} {high:.1}V{low:.1}\"/>");
            if times {
                let _ = write!(
                    out,
                    "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{} s</text>",
                    low + 14.0,
                    number(secs)
                );
            }
        }
        let ([left, right], [low, high]) = (self.x, self.y);
        let _ = write!(out, "<path class=\"axis\" d=\"M{left:.1} {high:.1}V{low:.1}H{right:.1}\"/>");
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>", left - 44.0, high - 6.0, escape(unit));
    }

    /// A curve through points of time and value; values beyond the frame are drawn at its edge.
    pub fn curve(&self, class: &str, points: impl Iterator<Item = (f64, f64)>, out: &mut String) {
        let _ = write!(out, "<polyline class=\"{class}\" points=\"");
        for (secs, value) in points.filter(|(_, value)| value.is_finite()) {
            let (x, y) = self.place(secs, value);
            let _ = write!(out, "{x:.1},{y:.1} ");
        }
        out.push_str("\"/>");
    }

    /// Everything between two values.
    pub fn band(&self, low: f64, high: f64, out: &mut String) {
        let ((x, bottom), (right, top)) = (self.place(self.time[0], low), self.place(self.time[1], high));
        let (width, height) = (right - x, bottom - top);
        let _ = write!(
            out,
            "<rect class=\"band\" x=\"{x:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/>"
        );
    }
}

/// Round numbers in a range, about four.
fn lines([low, high]: [f64; 2]) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return Vec::new();
    }
    let power = 10f64.powf((span / LINES).log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|step| step * power).into_iter().find(|step| span / step <= LINES + 1.0);
    let step = step.unwrap_or(span);
    let first = (low / step).ceil();
    let line = |index: usize| (first + index as f64) * step;
    (0..MOST_LINES).map(line).take_while(|value| *value <= high + 1e-9 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_are_round() {
        assert_eq!(lines([0.0, 2.0]), [0.0, 0.5, 1.0, 1.5, 2.0]);
        assert_eq!(lines([-0.13, 0.21]).len(), 4);
        assert!(lines([1.0, 1.0]).is_empty() && lines([0.0, f64::NAN]).is_empty());
    }

    proptest! {
        #[test]
        fn whatever_is_drawn_lies_inside(value in any::<f64>(), low in -1e6..1e6f64, span in 0.0..1e6f64) {
            let value_range = [low, low + span];
            let frame = Frame { x: [50.0, 700.0], y: [200.0, 20.0], time: [0.0, 2.0], value: value_range };
            let (x, y) = frame.place(1.0, if value.is_nan() { 0.0 } else { value });
            prop_assert!((50.0..=700.0).contains(&x) && (20.0..=200.0).contains(&y));
            prop_assert!(lines(frame.value).len() <= MOST_LINES);
        }
    }
}
