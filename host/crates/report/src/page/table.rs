//! Tables: columns of words and of numbers, in sections.

use super::escape;
use std::fmt::Write;

/// A table, as it is being put together.
///
/// ```
/// use camrig_report::{numbers::amount, page::Table};
/// let mut table = Table::new(&["figure", "symbol", "unit"]).numbers(&["R", "G"]);
/// table.section("Sensitivity");
/// table.row(vec!["System gain".into(), "K".into(), "DN/e⁻".into(),
///     amount(0.03428, Some(1e-4), ""), amount(0.034167, Some(6e-5), "")]);
/// assert!(table.html().contains("0.034167\u{2009}±\u{2009}0.000060"));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Table {
    columns: Vec<(String, Column)>,
    rows: Vec<Row>,
}

/// What the cells of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Words,
    Numbers,
    Symbols,
}

#[derive(Clone, Debug)]
enum Row {
    Section(String),
    Cells(Vec<String>),
}

impl Table {
    /// A table with columns of words.
    pub fn new(words: &[&str]) -> Self {
        Self::default().columns(words, Column::Words)
    }

    /// Adds columns of numbers, which stand at the right side of their columns.
    pub fn numbers(self, headings: &[&str]) -> Self {
        self.columns(headings, Column::Numbers)
    }

    /// Adds columns of words.
    pub fn words(self, headings: &[&str]) -> Self {
        self.columns(headings, Column::Words)
    }

    /// Adds columns of symbols: what follows a `_` is set low, as in `σ_y.dark`.
    pub fn symbols(self, headings: &[&str]) -> Self {
        self.columns(headings, Column::Symbols)
    }

    fn columns(mut self, headings: &[&str], kind: Column) -> Self {
        self.columns.extend(headings.iter().map(|h| ((*h).to_owned(), kind)));
        self
    }

    /// Adds a row of cells.
    pub fn row(&mut self, cells: Vec<String>) -> &mut Self {
        self.rows.push(Row::Cells(cells));
        self
    }

    /// Adds rows of cells.
    pub fn rows(&mut self, rows: impl IntoIterator<Item = Vec<String>>) -> &mut Self {
        self.rows.extend(rows.into_iter().map(Row::Cells));
        self
    }

    /// Begins a section with a heading over all columns.
    pub fn section(&mut self, heading: &str) -> &mut Self {
        self.rows.push(Row::Section(heading.into()));
        self
    }

    /// Whether there is no row of cells.
    pub fn is_empty(&self) -> bool {
        !self.rows.iter().any(|row| matches!(row, Row::Cells(_)))
    }

    /// The table as HTML.
    pub fn html(&self) -> String {
        let class = |i: usize| match self.columns.get(i) {
            Some((_, Column::Numbers)) => " class=\"n\"",
            _ => "",
        };
        let mut out = String::from("<div class=\"scroll\"><table>");
        if self.columns.iter().any(|(heading, _)| !heading.is_empty()) {
            out.push_str("<thead><tr>");
            for (i, (heading, _)) in self.columns.iter().enumerate() {
                add(&mut out, format_args!("<th{}>{}</th>", class(i), escape(heading)));
            }
            out.push_str("</tr></thead>");
        }
        out.push_str("<tbody>\n");
        for row in &self.rows {
            match row {
                Row::Section(heading) => add(
                    &mut out,
                    format_args!(
                        "<tr class=\"sec\"><td colspan=\"{}\">{}</td></tr>\n",
                        self.columns.len(),
                        escape(heading)
                    ),
                ),
                Row::Cells(cells) => {
                    out.push_str("<tr>");
                    for (i, cell) in cells.iter().enumerate() {
                        let text = match self.columns.get(i) {
                            Some((_, Column::Symbols)) => symbol(cell),
                            _ => escape(cell),
                        };
                        add(&mut out, format_args!("<td{}>{text}</td>", class(i)));
                    }
                    out.push_str("</tr>\n");
                }
            }
        }
        out + "</tbody></table></div>\n"
    }
}

fn symbol(text: &str) -> String {
    match text.split_once('_') {
        Some((letter, index)) => format!("{}<sub>{}</sub>", escape(letter), escape(index)),
        None => escape(text),
    }
}

/// Writing to a String does not fail.
fn add(out: &mut String, what: std::fmt::Arguments<'_>) {
    let _ = out.write_fmt(what);
}
