//! Drawings of numbers, as SVG. Series differ in stroke, marker or shade as well as in colour, for
//! print and for colour-blind readers. The legend has its own lines above the axes, as many as it
//! needs.

mod drawing;
mod layout;
mod number;
mod paint;

use anyhow::Context as _;
use maud::html;
use plotters::prelude::*;

pub use drawing::{Drawing, Mark, Point, Series};
pub use number::short;

use layout::{AXES, Layout, WIDTH};
use paint::{COLOURS, GRID};

impl Drawing {
    /// As the text of an SVG file, on white.
    ///
    /// # Errors
    /// If it has no points.
    pub fn svg(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        let layout = Layout::of(self);
        let size = (WIDTH as u32, (layout.top + AXES + layout.below) as u32);
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        self.paint(&area, &layout).context("cannot draw the figure")?;
        drop(area);
        let title = html! { (self.title) }.into_string();
        Ok(text.replacen("<svg ", &format!("<svg role=\"img\" aria-label=\"{title}\" "), 1))
    }

    /// As part of a page: the same, in the colours of the page's styles.
    ///
    /// # Errors
    /// If it has no points.
    pub fn inline(&self) -> anyhow::Result<String> {
        let series = COLOURS.iter().zip(1..).map(|(colour, number)| (*colour, format!("series-{number}")));
        let others = [(BLACK, "ink"), (WHITE, "paper"), (GRID, "faint")]
            .map(|(colour, name)| (colour, name.to_string()));
        Ok(series.chain(others).fold(self.svg()?, |text, (RGBColor(red, green, blue), name)| {
            text.replace(&format!("\"#{red:02X}{green:02X}{blue:02X}\""), &format!("\"var(--{name})\""))
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::layout::lines;
    use super::number::number;
    use super::*;

    fn drawing(groups: &[&str]) -> Drawing {
        let points = (0..3)
            .map(|i| Point {
                x: f64::from(i),
                y: 0.3 * f64::from(i),
                interval: Some([0.2 * f64::from(i), 0.4]),
            })
            .collect::<Vec<_>>();
        let series = ["F1, twin", "a <b> & c"].map(|name| Series {
            name: name.to_string(),
            points: points.clone(),
            marks: Vec::new(),
        });
        Drawing {
            title: "What & \"why\"".to_string(),
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
            assert!(svg.starts_with("<svg role=\"img\" aria-label=\"What &amp; &quot;why&quot;\" "), "{svg}");
            assert!(svg.contains("F1, twin") && svg.contains("a &lt;b&gt; &amp; c"), "{svg}");
            assert!(groups.iter().all(|name| svg.contains(name)), "{svg}");
            assert_eq!(drawing.svg().unwrap(), svg);
        }
        assert!(Drawing::default().svg().is_err());
    }

    #[test]
    fn a_file_is_on_white_and_a_part_of_a_page_has_no_colour_of_its_own() {
        for groups in [&[][..], &["one", "two", "three"]] {
            let mut drawing = drawing(groups);
            drawing.series[0].marks = vec![Mark { x: Some(1.0), y: 0.5 }, Mark { x: None, y: 0.9 }];
            assert!(drawing.svg().unwrap().contains("fill=\"#FFFFFF\""));
            let inline = drawing.inline().unwrap();
            assert!(!inline.contains("\"#"), "{inline}");
            for name in ["paper", "ink", "faint", "series-1", "series-2"] {
                assert!(inline.contains(&format!("var(--{name})")), "{name}");
            }
        }
    }

    /// A legend of any length ends above the axes.
    #[test]
    fn the_legend_has_its_own_lines_above_the_axes() {
        let mut drawing = drawing(&[]);
        let one = drawing.series[0].clone();
        for count in [1, 2, 9] {
            drawing.series = (0..count)
                .map(|i| Series { name: format!("the series of number {i}"), ..one.clone() })
                .collect();
            let layout = Layout::of(&drawing);
            assert_eq!(layout.legend.len(), if count > 1 { count } else { 0 });
            let lowest = layout.legend.iter().map(|[_, y]| *y).max().unwrap_or(0);
            assert!(lowest + 8 < layout.top + 10, "{count}: {lowest} and {}", layout.top);
            for pair in layout.legend.windows(2) {
                let right = pair[0][0] + 28 + 22 * 6;
                assert!(pair[1][1] > pair[0][1] || pair[1][0] >= right, "{pair:?}");
            }
        }
    }

    #[test]
    fn marks_are_named_and_within_the_range() {
        let mut drawing = drawing(&["one", "two", "three"]);
        drawing.marks = "the paper".to_string();
        assert!(!drawing.svg().unwrap().contains("the paper"), "without a mark there is nothing to name");
        drawing.series[1].marks = vec![Mark { x: Some(2.0), y: 7.5 }];
        assert!(drawing.svg().unwrap().contains("the paper"));
        assert!(drawing.range().unwrap().1[1] > 7.5);
    }

    #[test]
    fn long_names_are_broken_or_written_upwards() {
        assert_eq!(lines("are-you-sleeping", 10), ["are-you-", "sleeping"]);
        assert_eq!(lines("no randomisation at all", 16), ["no randomisation", "at all"]);
        let names = |groups: &[&str]| Layout::of(&drawing(groups)).names;
        assert_eq!(names(&["no randomisation", "C_dr 0.5", "x"]).unwrap()[0], ["no randomisation"]);
        assert!(names(&["incomprehensible"; 9]).is_none());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.25, 200_000.0, 3e6, 0.0, 100.0].map(number), ["0.25", "200k", "3M", "0", "100"]);
        assert_eq!(short(100.0, 0), "100");
    }
}
