//! A self-contained HTML page: it loads nothing, and is readable on a phone, in print, on a dark
//! background and without script.
//!
//! A page is written top to bottom. Parts that hold others take a closure that writes them:
//! ```
//! use camrig_report::page::{KeyFigure, Page, Tone};
//! let mut page = Page::new("My sensor");
//! page.kind("Data sheet").command("camrig datasheet my.toml");
//! page.verdict(Tone::Good, "explained", "Three effects account for the whole disagreement.");
//! page.key_figures(&[KeyFigure::new("Read noise", "5.70 ± 0.27 e⁻").below("40 °C, 10 ms")]);
//! page.folded("All captures", |page| {
//!     page.paragraph("dark-short, dark-long");
//! });
//! assert!(page.html().contains("<details>"));
//! ```

mod table;

pub use table::Table;

use crate::plot::{self, Plot, Size};
use base64::Engine;
use std::fmt::Write;

const STYLE: &str = include_str!("style.css");
/// Values on hover, zoom, keys and export; without it a page loses nothing that is printed.
const SCRIPT: &str = include_str!("figure.js");
const HINT: &str = "This file is complete in itself: nothing is loaded from a network. Drag in a \
                    plot to zoom, double-click for the whole range; hover or arrow keys for \
                    values.";

/// A page being written, top to bottom.
pub struct Page {
    title: String,
    kind: String,
    subtitle: String,
    command: String,
    body: String,
}

/// What a word means for the reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Tone {
    /// As it should be.
    Good,
    /// Needs attention.
    Warning,
    /// Not as it should be.
    Bad,
}

impl Tone {
    fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Warning => "warn",
            Self::Bad => "bad",
        }
    }
}

/// A key figure: on a card, with its name above and a line below.
#[derive(Clone, Debug)]
pub struct KeyFigure {
    name: String,
    value: String,
    below: String,
    status: Option<(Tone, String)>,
    picked: bool,
}

impl KeyFigure {
    /// A name, and a value with its unit.
    pub fn new(name: &str, value: &str) -> Self {
        Self {
            name: name.into(),
            value: value.into(),
            below: String::new(),
            status: None,
            picked: false,
        }
    }

    /// Adds a line below: the condition, what it means.
    pub fn below(mut self, text: &str) -> Self {
        self.below = text.into();
        self
    }

    /// Adds a word in the colour of its meaning at the end of the line below.
    pub fn status(mut self, tone: Tone, word: &str) -> Self {
        self.status = Some((tone, word.into()));
        self
    }

    /// Frames the card: the one that was chosen.
    pub fn picked(mut self) -> Self {
        self.picked = true;
        self
    }

    fn html(&self) -> String {
        let class = if self.picked { "card pick" } else { "card" };
        let status = self.status.as_ref().map_or_else(String::new, |(tone, word)| {
            let dot = if self.below.is_empty() { "" } else { " · " };
            format!("{dot}<span class=\"{}\">{}</span>", tone.class(), escape(word))
        });
        format!(
            "<div class=\"{class}\"><span class=\"soft\">{}</span><b class=\"big\">{}</b>\
             <span class=\"soft\">{}{status}</span></div>",
            escape(&self.name),
            escape(&self.value),
            escape(&self.below)
        )
    }
}

/// Text with the special characters of HTML escaped.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

/// A PNG as an address that holds it.
pub(crate) fn data_uri(png: &[u8]) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(png);
    format!("data:image/png;base64,{data}")
}

impl Page {
    /// A page with a title, which is also its first heading.
    pub fn new(title: &str) -> Self {
        let [kind, subtitle, command, body] = [const { String::new() }; 4];
        Self { title: title.into(), kind, subtitle, command, body }
    }

    /// Sets the kind of page, above the title.
    pub fn kind(&mut self, text: &str) -> &mut Self {
        self.kind = text.into();
        self
    }

    /// Sets the line below the title.
    pub fn subtitle(&mut self, text: &str) -> &mut Self {
        self.subtitle = text.into();
        self
    }

    /// Sets the command that made the page, for its foot.
    pub fn command(&mut self, text: &str) -> &mut Self {
        self.command = text.into();
        self
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<h2>{}</h2>\n", escape(text)))
    }

    /// Adds a heading that begins a new sheet in print.
    pub fn heading_on_new_sheet(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<h2 class=\"page\">{}</h2>\n", escape(text)))
    }

    /// Adds a small heading.
    pub fn subheading(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<h3>{}</h3>\n", escape(text)))
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<p>{}</p>\n", escape(text)))
    }

    /// Adds a paragraph of small print.
    pub fn small(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<p class=\"small\">{}</p>\n", escape(text)))
    }

    /// Adds a note that the reader must not miss: a warning, a lower limit.
    pub fn note(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<p class=\"note\">{}</p>\n", escape(text)))
    }

    /// Adds a verdict: a word in the colour of its meaning, and what it means.
    pub fn verdict(&mut self, tone: Tone, word: &str, text: &str) -> &mut Self {
        self.add(format_args!(
            "<div class=\"verdict\"><p class=\"badge {}\">{}</p><p>{}</p></div>\n",
            tone.class(),
            escape(word),
            escape(text)
        ))
    }

    /// Adds a word in the colour of its meaning.
    pub fn badge(&mut self, tone: Tone, word: &str) -> &mut Self {
        self.add(format_args!("<p class=\"badge {}\">{}</p>\n", tone.class(), escape(word)))
    }

    /// Adds how a figure changed, large.
    pub fn change(&mut self, before: &str, after: &str) -> &mut Self {
        self.add(format_args!(
            "<p class=\"change\"><span>{}</span><i>→</i><b>{}</b></p>\n",
            escape(before),
            escape(after)
        ))
    }

    /// Adds a row of cards with key figures; on a phone, four or more are in pairs.
    pub fn key_figures(&mut self, figures: &[KeyFigure]) -> &mut Self {
        let cards: String = figures.iter().map(KeyFigure::html).collect();
        self.add(format_args!("<div class=\"cards\">{cards}</div>\n"))
    }

    /// Adds a table of words: header cells, then rows of cells.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) -> &mut Self {
        let mut table = Table::new(header);
        table.rows(rows.iter().cloned());
        self.rows(&table)
    }

    /// Adds a table.
    pub fn rows(&mut self, table: &Table) -> &mut Self {
        self.add(format_args!("{}", table.html()))
    }

    /// Adds names and values, a pair a line: set-up, operating point.
    pub fn facts<N: AsRef<str>>(&mut self, facts: &[(N, String)]) -> &mut Self {
        let pair = |(name, value): &(N, String)| {
            format!("<dt>{}</dt><dd>{}</dd>", escape(name.as_ref()), escape(value))
        };
        let pairs: String = facts.iter().map(pair).collect();
        self.add(format_args!("<dl class=\"kv\">{pairs}</dl>\n"))
    }

    /// Adds a plot; several belong into [`Page::grid`].
    pub fn plot(&mut self, plot: &Plot) -> &mut Self {
        self.add(format_args!("{}", plot.figure("")))
    }

    /// Adds a headline plot in its two forms: [`Size::WIDE`] for desks and print,
    /// [`Size::NARROW`] for phones. `draw` sets the size it is given.
    pub fn headline(&mut self, draw: impl Fn(Size) -> Plot) -> &mut Self {
        self.add(format_args!(
            "{}{}",
            draw(Size::WIDE).figure("only-wide"),
            draw(Size::NARROW).figure("only-narrow")
        ))
    }

    /// Adds a picture from PNG bytes; the caption is also its alternative text.
    pub fn picture(&mut self, png: &[u8], caption: &str) -> &mut Self {
        self.thumbnail(png, caption, caption)
    }

    /// Adds a picture from PNG bytes with alternative text and a caption.
    pub fn thumbnail(&mut self, png: &[u8], alt: &str, caption: &str) -> &mut Self {
        self.add_picture("pic", png, alt, caption)
    }

    /// Adds a picture of few samples, each shown as a square, with alternative text and a caption.
    pub fn samples(&mut self, png: &[u8], alt: &str, caption: &str) -> &mut Self {
        self.add_picture("pic pix", png, alt, caption)
    }

    /// Adds a drawing from trusted SVG text, which is not escaped.
    pub fn drawing(&mut self, svg: &str, caption: &str) -> &mut Self {
        let caption = escape(caption);
        self.add(format_args!("<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"))
    }

    /// Adds preformatted text, for files and commands.
    pub fn verbatim(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<pre>{}</pre>\n", escape(text)))
    }

    /// Adds figures side by side: three on a desktop, two on A4, one on a phone.
    pub fn grid(&mut self, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.within("div class=\"grid\"", "div", write)
    }

    /// Adds small multiples side by side, plots of [`Size::SMALL`]: four on a desktop.
    pub fn small_multiples(&mut self, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.within("div class=\"grid small\"", "div", write)
    }

    /// Adds pictures side by side.
    pub fn pictures(&mut self, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.within("div class=\"pics\"", "div", write)
    }

    /// Adds two parts side by side, the first somewhat wider; on a phone, one below the other.
    pub fn beside(
        &mut self,
        first: impl FnOnce(&mut Self),
        second: impl FnOnce(&mut Self),
    ) -> &mut Self {
        self.within("div class=\"two\"", "div", |page| {
            page.within("div", "div", first).within("div", "div", second);
        })
    }

    /// Adds the first sheet of a data sheet: a table, and to its right facts above a figure. In
    /// print the table is above both, all small enough for one sheet.
    pub fn data_sheet(
        &mut self,
        table: impl FnOnce(&mut Self),
        facts: impl FnOnce(&mut Self),
        figure: impl FnOnce(&mut Self),
    ) -> &mut Self {
        self.within("div class=\"sheet\"", "div", |page| {
            page.within("div", "div", table).within("div class=\"side\"", "div", |page| {
                page.within("div", "div", facts).within("div", "div", figure);
            });
        })
    }

    /// Adds the opening of a page: text, and to its right a headline figure; on a phone and in
    /// print the text is above.
    pub fn opening(
        &mut self,
        words: impl FnOnce(&mut Self),
        figure: impl FnOnce(&mut Self),
    ) -> &mut Self {
        self.within("div class=\"opening\"", "div", |page| {
            page.within("div", "div", words).within("div", "div", figure);
        })
    }

    /// Adds a plot of [`Size::FIGURE`] or a headline, and its table or text to the right.
    pub fn evidence(
        &mut self,
        figure: impl FnOnce(&mut Self),
        side: impl FnOnce(&mut Self),
    ) -> &mut Self {
        self.within("div class=\"evidence\"", "div", |page| {
            page.within("div", "div", figure).within("div", "div", side);
        })
    }

    /// Adds what is shown on demand, and in print.
    pub fn folded(&mut self, summary: &str, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.add(format_args!("<details><summary>{}</summary>\n", escape(summary)));
        write(self);
        self.add(format_args!("</details>\n"))
    }

    /// Adds what is shown on demand, and not printed: what a file has for those who need it.
    pub fn folded_on_screen(&mut self, summary: &str, write: impl FnOnce(&mut Self)) -> &mut Self {
        let summary = escape(summary);
        self.add(format_args!("<details class=\"noprint\"><summary>{summary}</summary>\n"));
        write(self);
        self.add(format_args!("</details>\n"))
    }

    /// Adds what belongs together; in print its heading stays with its first figure.
    pub fn together(&mut self, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.within("section class=\"keep\"", "section", write)
    }

    /// The whole page.
    pub fn html(&self) -> String {
        let Self { title, kind, subtitle, command, body } = self;
        let line = |class: &str, text: &str| match text {
            "" => String::new(),
            text => format!("<p class=\"{class}\">{}</p>", escape(text)),
        };
        let version = env!("CARGO_PKG_VERSION");
        let made = match &command[..] {
            "" => format!("Made by camrig {version}."),
            text => format!("Made by camrig {version} with <code>{}</code>.", escape(text)),
        };
        // The script only where it has something to do.
        let (hint, script) = match body.contains("class=\"plot") {
            true => (HINT, format!("<script>{}</script>", script())),
            false => ("", String::new()),
        };
        let colours = plot::page_style();
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>{title}</title><link rel=\"icon\" href=\"data:,\">\
             <style>{colours}\n{}{STYLE}</style></head>\n<body>\n\
             <header>{}<h1>{title}</h1>{}</header>\n<main>\n{body}</main>\n\
             <footer>{made} <span class=\"noprint\">{hint}</span></footer>{script}\n\
             </body></html>\n",
            plot::STYLE,
            line("kind", kind),
            line("sub", subtitle),
            title = escape(title),
        )
    }

    fn add_picture(&mut self, class: &str, png: &[u8], alt: &str, caption: &str) -> &mut Self {
        let caption = match caption {
            "" => String::new(),
            caption => format!("<figcaption>{}</figcaption>", escape(caption)),
        };
        self.add(format_args!(
            "<figure class=\"{class}\"><img alt=\"{}\" src=\"{}\">{caption}</figure>\n",
            escape(alt),
            data_uri(png)
        ))
    }

    fn within(&mut self, open: &str, close: &str, write: impl FnOnce(&mut Self)) -> &mut Self {
        self.add(format_args!("<{open}>\n"));
        write(self);
        self.add(format_args!("</{close}>\n"))
    }

    fn add(&mut self, text: std::fmt::Arguments<'_>) -> &mut Self {
        // Writing to a String does not fail.
        let _ = self.body.write_fmt(text);
        self
    }
}

/// The script without its indentation.
fn script() -> String {
    SCRIPT.lines().map(str::trim_start).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Colour, Mark};

    #[test]
    fn text_from_outside_stays_text() {
        const BAD: &str = "</p></script><script>alert(1)</script>\"";
        let mut page = Page::new(BAD);
        page.kind(BAD).subtitle(BAD).command(BAD).paragraph(BAD).verbatim(BAD).note(BAD);
        page.table(&[BAD], &[vec![BAD.into()]]).facts(&[(BAD, BAD.into())]);
        page.key_figures(&[KeyFigure::new(BAD, BAD).below(BAD).status(Tone::Bad, BAD)]);
        page.verdict(Tone::Good, BAD, BAD).change(BAD, BAD).picture(b"", BAD);
        page.folded(BAD, |_| ());
        let mut plot = Plot::new(BAD, BAD, BAD);
        plot.series(BAD, Mark::Line, Colour::Red, vec![[0.0, 1.0]]).note(BAD).limit_x(0.0, BAD);
        page.plot(&plot);
        let html = page.html();
        assert!(!html.contains("<script>alert"));
        assert_eq!(html.matches("</script>").count(), 2, "the data's and the page's own");
    }

    #[test]
    fn a_page_without_plots_has_no_script() {
        assert!(!Page::new("a").paragraph("b").html().contains("<script"));
    }

    #[test]
    fn the_script_stays_small() {
        assert!(script().len() < 10_000, "{} bytes", script().len());
    }
}
