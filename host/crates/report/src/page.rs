//! A self-contained HTML page: it loads nothing, and is readable on a phone, in print and on a
//! dark background.

use base64::Engine;
use std::fmt::Write;

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c1f23;--soft:#5c6670;--line:#d8dde3;--paper:#fff}\
@media(prefers-color-scheme:dark){\
:root{--ink:#e6e9ec;--soft:#9aa5b1;--line:#3a424b;--paper:#15181c}}\
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);margin:0 auto;\
padding:1rem;max-width:60rem}\
h1,h2,p,figcaption{overflow-wrap:anywhere}h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2rem}\
figure{margin:1rem 0}figcaption{color:var(--soft)}img,svg{max-width:100%;height:auto}\
.scroll{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
th,td{text-align:left;vertical-align:top;padding:.25rem .75rem;\
border-bottom:1px solid var(--line)}\
pre{overflow-x:auto;border:1px solid var(--line);padding:.75rem;font-size:.85rem}\
@media print{body{max-width:none}h2,figure,table{break-inside:avoid}}";

/// A page being written, top to bottom.
pub struct Page {
    body: String,
    title: String,
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

impl Page {
    /// A page with a title, which is also its first heading.
    pub fn new(title: &str) -> Self {
        Self { title: escape(title), body: format!("<h1>{}</h1>\n", escape(title)) }
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<h2>{}</h2>\n", escape(text)))
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.add(format_args!("<p>{}</p>\n", escape(text)))
    }

    /// Adds a table: header cells, then rows of cells.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) -> &mut Self {
        let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
            cells.map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect::<String>()
        };
        self.add(format_args!(
            "<div class=\"scroll\"><table><tr>{}</tr>\n",
            cells("th", &mut header.iter().copied())
        ));
        for row in rows {
            let row = cells("td", &mut row.iter().map(String::as_str));
            self.add(format_args!("<tr>{row}</tr>\n"));
        }
        self.add(format_args!("</table></div>\n"))
    }

    /// Adds a picture from PNG bytes.
    pub fn picture(&mut self, png: &[u8], caption: &str) -> &mut Self {
        let data = base64::engine::general_purpose::STANDARD.encode(png);
        let caption = escape(caption);
        self.add(format_args!(
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">\
             <figcaption>{caption}</figcaption></figure>\n"
        ))
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

    /// The whole page.
    pub fn html(&self) -> String {
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width\"><title>{}</title>\
             <link rel=\"icon\" href=\"data:,\"><style>{STYLE}</style></head>\n<body>\n{}\
             <p>camrig {}</p>\n</body></html>\n",
            self.title,
            self.body,
            env!("CARGO_PKG_VERSION")
        )
    }

    fn add(&mut self, text: std::fmt::Arguments<'_>) -> &mut Self {
        // Writing to a String does not fail.
        let _ = self.body.write_fmt(text);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_outside_stays_text() {
        let mut page = Page::new("a <script> & \"b\"");
        page.paragraph("</p><script>alert(1)</script>").verbatim("<b>");
        let html = page.html();
        assert!(!html.contains("<script>"));
        assert!(html.contains("&lt;script&gt;"));
    }
}
