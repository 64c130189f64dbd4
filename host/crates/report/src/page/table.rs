//! Tables: columns of words and of numbers, in sections.

use super::escape;
use crate::plot::text;
use std::fmt::Write;

/// Width of a table on a phone without the scroll bar, and padding of a cell, px.
const PHONE: f64 = 346.0;
const BESIDE: f64 = 5.0;
/// Sizes of text in cells and in heads, which are bold, on a phone over that of figures.
const CELL: f64 = 13.0 / text::SIZE;
const HEAD: f64 = 1.1 * 12.5 / text::SIZE;
/// Widest heading that is put above its value if a row is broken up, px.
const ABOVE: f64 = 76.0;

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

/// How a phone shows a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Whole,
    Blocks,
    Lists,
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

    /// Adds right-aligned columns of numbers.
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

    /// How a phone shows the table: as it is where it fits; otherwise each row as a block, its
    /// numbers side by side below their heads if these are short, or a line each.
    fn form(&self) -> Form {
        let word = |text: &str| text.split(' ').map(text::width).fold(0.0, f64::max);
        let of_column = |(i, (heading, kind)): (usize, &(String, Column))| {
            let cells = self.rows.iter().filter_map(|row| match row {
                Row::Cells(cells) => cells.get(i),
                Row::Section(_) => None,
            });
            let of_cell = |cell: &String| match kind {
                Column::Numbers => text::width(cell),
                _ => word(cell),
            };
            let cells = cells.map(of_cell).fold(0.0, f64::max);
            (CELL * cells).max(HEAD * word(heading)) + BESIDE
        };
        let needed: f64 = self.columns.iter().enumerate().map(of_column).sum();
        let numbers = self.columns.iter().filter(|(_, kind)| *kind == Column::Numbers);
        let widest = numbers.map(|(heading, _)| text::width(heading)).fold(0.0, f64::max);
        match needed <= PHONE + BESIDE {
            true => Form::Whole,
            false if widest <= ABOVE => Form::Blocks,
            false => Form::Lists,
        }
    }

    /// Attributes of a cell of a column.
    fn attributes(&self, i: usize, form: Form) -> String {
        let Some((heading, kind)) = self.columns.get(i) else { return String::new() };
        let class = if *kind == Column::Numbers { " class=\"n\"" } else { "" };
        let named = match (form, kind) {
            (Form::Whole, _) | (Form::Blocks, Column::Words | Column::Symbols) => false,
            (Form::Blocks, Column::Numbers) => true,
            (Form::Lists, _) => i > 0 && !heading.is_empty(),
        };
        match named {
            true => format!("{class} data-h=\"{}\"", escape(heading)),
            false => class.to_owned(),
        }
    }

    /// The table as HTML.
    pub fn html(&self) -> String {
        let form = self.form();
        let class = match form {
            Form::Whole => "",
            Form::Blocks => " class=\"blocks\"",
            Form::Lists => " class=\"blocks list\"",
        };
        let mut out = format!("<div class=\"scroll\"><table{class}>");
        if self.columns.iter().any(|(heading, _)| !heading.is_empty()) {
            out.push_str("<thead><tr>");
            for (i, (heading, _)) in self.columns.iter().enumerate() {
                let attributes = self.attributes(i, Form::Whole);
                add(&mut out, format_args!("<th{attributes}>{}</th>", escape(heading)));
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
                        let attributes = self.attributes(i, form);
                        add(&mut out, format_args!("<td{attributes}>{text}</td>"));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_phone_shows_a_table_as_it_is_only_where_it_fits() {
        let with = |heads: &[&str]| {
            let mut table = Table::new(&["figure"]).numbers(heads);
            table.row(vec!["0.03414\u{2009}±\u{2009}0.00013".into(); heads.len() + 1]);
            table
        };
        assert_eq!(with(&["R", "G"]).form(), Form::Whole);
        assert_eq!(with(&["R", "Gr", "Gb", "B"]).form(), Form::Blocks);
        let long = with(&["R", "G", "B", "MTF50 on the sensor, cycles/mm"]);
        assert_eq!(long.form(), Form::Lists);
        assert!(long.html().contains(" data-h=\"MTF50 on the sensor, cycles/mm\""));
        assert!(!with(&["R", "G"]).html().contains("data-h"));
    }
}
