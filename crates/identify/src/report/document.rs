//! The parts of a report as Markdown, and its charts as SVG. Texts are plain; they are escaped
//! here.

use plotters::coord::Shift;
use plotters::prelude::*;

/// Size of a chart.
const SIZE: (u32, u32) = (560, 320);
/// Room for the legend above the curves, as a share of their height.
const LEGEND: f64 = 0.3;
/// Colour and width of the curves: grey, and two of Okabe and Ito's colours, which colour-blind
/// readers can tell apart.
const STROKES: [(RGBColor, u32); 3] =
    [(RGBColor(187, 187, 187), 5), (RGBColor(213, 94, 0), 1), (RGBColor(0, 114, 178), 2)];

/// A report.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Its text as Markdown, which links each figure as `NAME.svg`.
    pub markdown: String,
    /// Its figures.
    pub figures: Vec<Figure>,
}

/// A chart of curves over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of its file, without extension.
    pub name: String,
    /// Caption.
    pub caption: String,
    /// Unit of the values.
    pub unit: &'static str,
    /// Curves: measured, before the fit, after the fit.
    pub curves: [Curve; 3],
}

/// A curve. Without points where the simulation diverged.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Name.
    pub name: &'static str,
    /// Time, s, and value.
    pub points: Vec<[f64; 2]>,
}

pub(super) fn paragraph(text: &str) -> String {
    format!("{}\n", escape(text))
}

pub(super) fn list(items: &[String]) -> String {
    items.iter().map(|item| format!("- {}\n", escape(item))).collect()
}

/// A table. Each row has one cell a column.
pub(super) fn table(caption: &str, columns: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let head = line(columns.iter().map(|name| escape(name)).collect());
    let rule = line(vec!["---".to_string(); columns.len()]);
    let rows = rows.into_iter().map(|row| line(row.iter().map(|cell| escape(cell)).collect()));
    format!("**{}**\n\n{head}{rule}{}", escape(caption), rows.collect::<String>())
}

impl Figure {
    pub(super) fn markdown(&self) -> String {
        format!("![{}]({}.svg)\n", escape(&self.caption), self.name)
    }

    /// The chart as an SVG file.
    pub fn svg(&self) -> String {
        let mut text = String::new();
        self.draw(&SVGBackend::with_string(&mut text, SIZE).into_drawing_area())
            .expect("a text can be drawn on");
        text
    }

    fn draw(
        &self,
        area: &DrawingArea<SVGBackend<'_>, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let range = |axis: usize| {
            let values = self.curves.iter().flat_map(|curve| &curve.points).map(|point| point[axis]);
            let [low, high] =
                values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
            if low < high { low..high } else { -1.0..1.0 }
        };
        let values = range(1);
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(56)
            .build_cartesian_2d(range(0), values.start..values.end + LEGEND * (values.end - values.start))?;
        chart.configure_mesh().disable_mesh().x_desc("s").y_desc(self.unit).draw()?;
        for (curve, (colour, width)) in self.curves.iter().zip(STROKES) {
            let stroke = colour.stroke_width(width);
            let diverged = if curve.points.is_empty() { " (diverged)" } else { "" };
            chart
                .draw_series(LineSeries::new(
                    curve.points.iter().map(|[secs, value]| (*secs, *value)),
                    stroke,
                ))?
                .label(format!("{}{diverged}", curve.name))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], stroke));
        }
        chart.configure_series_labels().position(SeriesLabelPosition::UpperRight).draw()?;
        area.present()
    }
}

/// Plain text as Markdown that shows the same characters. A file's name may hold markup and control
/// characters.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if "\\`*[]<>|&".contains(c) {
            out.push('\\');
        }
        out.push(if c.is_control() { '\u{fffd}' } else { c });
    }
    out
}
