//! Numbers and tables as text.

use itertools::Itertools;
/// Rows under a header, as an aligned Markdown table.
pub fn markdown(header: &[&str], rows: &[Vec<String>]) -> String {
    let width =
        |k: usize| rows.iter().map(|r| r[k].chars().count()).chain([header[k].chars().count()]).max().unwrap_or(0);
    let widths = (0..header.len()).map(width).collect_vec();
    let line = |cells: Vec<&str>| {
        let mut cells = cells.iter().zip(&widths).map(|(c, w)| format!(" {c}{} ", " ".repeat(w - c.chars().count())));
        format!("|{}|\n", cells.join("|"))
    };
    let rule = widths.iter().map(|w| "-".repeat(w + 2)).join("|");
    let body: String = rows.iter().map(|r| line(r.iter().map(String::as_str).collect())).collect();
    format!("{}|{rule}|\n{body}", line(header.to_vec()))
}

/// Numbers with three significant digits each, separated by ` / `.
pub fn pair(x: &[f64]) -> String {
    x.iter().map(|v| digits(*v)).join(" / ")
}

/// Text of a number with three significant digits.
pub fn digits(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let decimals = (2 - x.abs().log10().floor() as i32).clamp(0, 12) as usize;
    if !(1e-4..1e6).contains(&x.abs()) { format!("{x:.2e}") } else { format!("{x:.decimals$}") }
}
