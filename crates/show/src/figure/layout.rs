//! Where the parts of a drawing are.

use super::drawing::Drawing;

/// Width of a drawing: on a phone its letters are still read.
pub(super) const WIDTH: i32 = 480;
/// Height of the axes with their upper margin.
pub(super) const AXES: i32 = 250;
/// Room at the left of the axes, with the margin of the drawing.
pub(super) const LEFT: i32 = 62;
pub(super) const MARGIN: i32 = 8;
/// Room at their right: half a label sticks out there.
pub(super) const RIGHT: i32 = 24;
/// Height of a line of the heading and of all other lines.
pub(super) const HEADING: i32 = 19;
pub(super) const LINE: i32 = 17;
/// Sizes of letters in the heading and elsewhere.
pub(super) const LARGE: u32 = 15;
pub(super) const SMALL: u32 = 13;
/// Widths of their letters; plotters does not know the reader's font.
pub(super) const WIDE: f64 = 7.4;
pub(super) const NARROW: f64 = 6.5;
/// The most letters of a group's name that are written upwards.
pub(super) const MAX_NAME_CHARS: usize = 26;

/// Where the parts of a drawing are.
pub(super) struct Layout {
    /// The heading, by line.
    pub(super) title: Vec<String>,
    /// Place of each entry of the legend; that of the marks is the last.
    pub(super) legend: Vec<[i32; 2]>,
    /// Names of the groups, by line; none if they are written upwards.
    pub(super) names: Option<Vec<Vec<String>>>,
    /// Height of all that is above the axes.
    pub(super) top: i32,
    /// Height of all that is below them.
    pub(super) below: i32,
}

impl Layout {
    pub(super) fn of(drawing: &Drawing) -> Self {
        let title = lines(&drawing.title, letters(WIDTH - 24, WIDE));
        let begin = HEADING * title.len() as i32 + 18;
        let [mut x, mut y] = [LEFT, begin];
        let names = drawing.legend_names();
        let mut legend = Vec::new();
        for name in &names {
            let wide = (name.chars().count() as f64 * NARROW) as i32 + 46;
            if x + wide > WIDTH && x > LEFT {
                [x, y] = [LEFT, y + LINE];
            }
            legend.push([x, y]);
            x += wide;
        }
        let slot = letters((WIDTH - LEFT - RIGHT) / drawing.groups.len().max(1) as i32, NARROW);
        let names: Vec<Vec<String>> = drawing.groups.iter().map(|name| lines(name, slot)).collect();
        let is_narrow = names.iter().flatten().all(|line| line.chars().count() <= slot);
        let below = match names.iter().map(Vec::len).max() {
            Some(most) if is_narrow => 28 + LINE * most as i32,
            Some(_) => {
                let longest = drawing.groups.iter().map(|name| name.chars().count()).max().unwrap_or(0);
                34 + (longest.min(MAX_NAME_CHARS) as f64 * NARROW) as i32
            }
            None => 42,
        };
        let top = if legend.is_empty() { begin - 10 } else { y + 10 };
        Self { title, legend, names: is_narrow.then_some(names), top, below }
    }
}

/// How many letters fit.
fn letters(pixels: i32, letter: f64) -> usize {
    (f64::from(pixels) / letter) as usize
}

/// `text` in lines of `most` letters at most, where its words allow that.
pub(super) fn lines(text: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_inclusive([' ', '-']) {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.trim_end().chars().count() <= most => {
                line.push_str(word)
            }
            _ => lines.push(word.to_string()),
        }
    }
    lines.into_iter().map(|line| line.trim_end().to_string()).collect()
}
