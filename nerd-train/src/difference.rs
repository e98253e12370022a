//! Lists how the settings of two runs differ, for the error when a run is resumed with other settings.

use serde_json::Value;

/// Largest number of differences in a message.
const MOST: usize = 4;

/// Differences between two JSON texts by key, with the value in `found` first. The result is empty if the texts are
/// equal.
///
/// ```
/// let text = nerd_train::difference::between(r#"{"rate": {"start": 0.1}, "seed": 1}"#, r#"{"rate": {"start": 0.2}, "seed": 1}"#);
/// assert_eq!(text, "`rate.start` was 0.1, is 0.2 now");
/// ```
pub fn between(found: &str, asked: &str) -> String {
    let (Ok(a), Ok(b)) = (serde_json::from_str(found), serde_json::from_str(asked)) else {
        return if found == asked { String::new() } else { format!("it was `{found}`, is `{asked}` now") };
    };
    let mut all = Vec::new();
    compare("", &a, &b, &mut all);
    let more = all.len().saturating_sub(MOST);
    all.truncate(MOST);
    if more > 0 {
        all.push(format!("{more} more"));
    }
    all.join(", ")
}

fn compare(at: &str, a: &Value, b: &Value, out: &mut Vec<String>) {
    if let (Value::Object(a), Value::Object(b)) = (a, b) {
        let keys = a.keys().chain(b.keys().filter(|k| !a.contains_key(*k)));
        for key in keys {
            let at = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
            compare(&at, a.get(key).unwrap_or(&Value::Null), b.get(key).unwrap_or(&Value::Null), out);
        }
    } else if a != b {
        let word = |x: &Value| if x.is_null() { "nothing".into() } else { x.to_string() };
        out.push(format!("`{at}` was {}, is {} now", word(a), word(b)));
    }
}
