//! What a report says, apart from how it looks: the page and the text are two renderings of the same
//! document.

/// A report.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Document {
    pub title: String,
    pub sections: Vec<Section>,
}

/// One part of it, with a heading.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Section {
    pub title: &'static str,
    pub elements: Vec<Element>,
}

/// What a section is made of. Strings are plain text: renderings escape them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Element {
    Paragraph(String),
    List(Vec<String>),
    Table(Table),
    /// The text leaves them out.
    Pictures(Vec<Picture>),
}

/// Rows of cells under a line of headings.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Table {
    pub caption: String,
    pub columns: Vec<Column>,
    /// As many cells a row as there are columns.
    pub rows: Vec<Vec<String>>,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub name: &'static str,
    /// Numbers stand at the right, words at the left.
    pub is_number: bool,
}

/// A drawing.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Picture {
    /// A whole `<svg>` element, escaped already.
    pub svg: String,
    /// What it shows.
    pub caption: String,
}

/// A column of words.
pub(super) fn words(name: &'static str) -> Column {
    Column { name, is_number: false }
}

/// A column of numbers.
pub(super) fn numbers(name: &'static str) -> Column {
    Column { name, is_number: true }
}
