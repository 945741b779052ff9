//! The parts of a report as Markdown, and its charts as SVG. Texts are plain; they are escaped here.

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
        let all = || self.curves.iter().flat_map(|curve| &curve.points);
        let range = |axis: usize| {
            let extent = all()
                .map(|point| point[axis])
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
            if extent[0] < extent[1] { extent } else { [-1.0, 1.0] }
        };
        let [[left, right], [low, high]] = [range(0), range(1)];
        let place = |[secs, value]: &[f64; 2]| {
            let (x, y) = ((secs - left) / (right - left), (value - low) / (high - low));
            format!("{:.1},{:.1} ", 60.0 + 410.0 * x, 250.0 - 220.0 * y)
        };
        let text = |x: f64, y: f64, text: String| format!("<text x=\"{x}\" y=\"{y}\">{text}</text>\n");
        // Okabe and Ito's colours, which colour-blind readers can tell apart.
        let strokes = ["#bbb\" stroke-width=\"5", "#d55e00\" stroke-dasharray=\"6 4", "#0072b2"]
            .into_iter()
            .zip([130.0, 240.0, 350.0]);
        let mut out = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 480 280\" font-size=\"12\" fill=\"none\">\n\
                       <style>text{font-family:sans-serif;fill:#111}</style>\n"
            .to_string();
        for (curve, (stroke, x)) in self.curves.iter().zip(strokes) {
            let points: String = curve.points.iter().map(place).collect();
            out += &format!(
                "<polyline stroke=\"{stroke}\" points=\"{points}\"/>\n<path stroke=\"{stroke}\" d=\"M{x} 14h30\"/>\n"
            );
            let diverged = if curve.points.is_empty() { " (diverged)" } else { "" };
            out += &text(x + 36.0, 18.0, format!("{}{diverged}", curve.name));
        }
        out += "<path stroke=\"#999\" d=\"M60 30V250H470\"/>\n";
        out += &text(4.0, 34.0, format!("{high:.1} {}", self.unit));
        out += &text(4.0, 250.0, format!("{low:.1}"));
        out += &text(60.0, 270.0, format!("{left:.2} s"));
        out + &text(430.0, 270.0, format!("{right:.2} s")) + "</svg>\n"
    }
}

/// Plain text as Markdown that shows the same characters. A file's name may hold markup and control characters.
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
