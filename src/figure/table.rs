//! The numbers of a picture as comma-separated values (RFC 4180, lines end in a single line feed).

/// One table of numbers, each row with a name of what it belongs to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// What tells it from the other tables of the same picture; empty for the main one.
    pub kind: String,
    /// Heads of the columns, the units in them. If it has one more than the rows have numbers, the
    /// first stands over the names.
    pub columns: Vec<String>,
    /// Rows: a name, left out where the columns have no place for it, and the numbers; what is not
    /// a number stays empty.
    pub rows: Vec<(String, Vec<f64>)>,
}

impl Table {
    /// The file's text. Numbers read back to the same bits.
    #[must_use]
    pub fn csv(&self) -> String {
        let heads: Vec<String> = self.columns.iter().map(|head| quoted(head)).collect();
        let mut text = heads.join(",") + "\n";
        for (name, numbers) in &self.rows {
            let mut separator = "";
            if numbers.len() < self.columns.len() {
                text.push_str(&quoted(name));
                separator = ",";
            }
            for number in numbers {
                text.push_str(separator);
                separator = ",";
                if number.is_finite() {
                    text.push_str(&number.to_string());
                }
            }
            text.push('\n');
        }
        text
    }
}

/// A field that separators, quotes and line ends cannot break.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}
