//! Writes HTML. Names, reasons and findings are untrusted: [`HtmlPage`] takes markup only as this program's literals, and escapes all else.

use crate::report::svg::{escape, Svg};
use std::fmt::Display;

/// HTML in progress.
#[derive(Default)]
pub struct HtmlPage(String);

impl HtmlPage {
    /// Markup: a literal, never a value.
    pub fn markup(&mut self, markup: &'static str) {
        self.0.push_str(markup);
    }

    /// Text of any origin, escaped.
    pub fn text(&mut self, text: impl Display) {
        self.0.push_str(&escape(&text.to_string()));
    }

    /// A chart, whose text is escaped.
    pub fn figure(&mut self, caption: &str, chart: &Svg) {
        self.markup("<figure><figcaption>");
        self.text(caption);
        self.markup("</figcaption>");
        self.0.push_str(chart.as_str());
        self.markup("</figure>");
    }

    /// The whole page.
    pub fn finish(self) -> String {
        self.0
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) {
        self.markup("<h2>");
        self.text(text);
        self.markup("</h2>");
    }

    /// Begins a table. Columns with a leading `#` hold numbers.
    pub fn table(&mut self, columns: &[&str]) {
        self.markup("<table><thead><tr>");
        for column in columns {
            match column.strip_prefix('#') {
                Some(column) => {
                    self.markup("<th class=\"n\">");
                    self.text(column);
                }
                None => {
                    self.markup("<th>");
                    self.text(column);
                }
            }
            self.markup("</th>");
        }
        self.markup("</tr></thead><tbody>");
    }

    /// A table's row.
    pub fn row(&mut self, columns: &[&str], cells: &[&dyn Display]) {
        self.markup("<tr>");
        for (column, cell) in columns.iter().zip(cells) {
            if column.starts_with('#') {
                self.markup("<td class=\"n\">")
            } else {
                self.markup("<td>")
            }
            self.text(cell);
            self.markup("</td>");
        }
        self.markup("</tr>");
    }

    /// Ends a table.
    pub fn end_table(&mut self) {
        self.markup("</tbody></table>");
    }
}
