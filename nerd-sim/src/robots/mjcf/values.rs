//! Types of MJCF attributes, from MuJoCo's schema: numbers and their counts, words, names of objects.

use std::collections::HashMap;
use std::sync::LazyLock;

use super::element::{Element, brief};
use crate::internal::*;

#[derive(Debug)]
pub(super) enum Value {
    Text,
    /// A nonempty text.
    Filled,
    /// A number of bytes, such as `4M`.
    Bytes,
    /// Name of an object of this kind. A text that ends in `type` names the attribute whose value is the kind.
    Named(&'static str),
    Numbers {
        kind: Number,
        least: usize,
        most: usize,
        bound: Option<(&'static str, f64)>,
    },
    /// Words, of which one (`word`), several, or several in this order (`ordered`) are allowed.
    Words(&'static str, Vec<&'static str>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Real,
    /// Single precision.
    Single,
    /// A 32-bit integer.
    Whole,
}

/// Types by `element.attribute`, `element.*` or attribute.
static VALUES: LazyLock<HashMap<&str, &Value>> = LazyLock::new(|| {
    let lines = include_str!("attributes.txt").lines().filter_map(|line| line.split_once(": "));
    let line = |(value, keys): (&'static str, &'static str)| {
        let value: &'static Value = Box::leak(Box::new(Value::read(value)));
        keys.split(' ').map(move |key| (key, value))
    };
    lines.flat_map(line).collect()
});

/// Type of an element's attribute.
pub(super) fn value_of(tag: &str, key: &str) -> &'static Value {
    let all = &*VALUES;
    all.get(&*format!("{tag}.{key}"))
        .or_else(|| all.get(&*format!("{tag}.*")))
        .or_else(|| all.get(key))
        .copied()
        .unwrap_or(&Value::Text)
}

impl Value {
    /// Parses `real 1-3`, `whole 1 >0`, `word true|false`, `named joint`.
    fn read(text: &'static str) -> Self {
        let mut words = text.split(' ');
        let mut next = || words.next().unwrap_or_default();
        let (first, second) = (next(), next());
        let kind = match first {
            "text" => return Self::Text,
            "filled" => return Self::Filled,
            "bytes" => return Self::Bytes,
            "named" => return Self::Named(second),
            "real" => Number::Real,
            "single" => Number::Single,
            "whole" => Number::Whole,
            _ => return Self::Words(first, second.split('|').collect()),
        };
        let (least, most) = second.split_once('-').unwrap_or((second, second));
        let bound =
            words.next().map(|bound| bound.split_at(bound.find(|c: char| c == '-' || c.is_ascii_digit()).unwrap_or(0)));
        Self::Numbers {
            kind,
            least: least.parse().unwrap_or(1),
            most: most.parse().unwrap_or(usize::MAX),
            bound: bound.map(|(sign, x)| (sign, x.parse().unwrap_or(0.0))),
        }
    }

    /// Refuses an attribute with text of another type.
    pub fn check(&self, e: &Element, key: &str, text: &str) -> Result<(), UrdfError> {
        let refused = |why: String| Err(e.refused(format!("{key}=\"{}\"{why}", brief(text))));
        match self {
            Self::Text | Self::Named(_) => Ok(()),
            Self::Filled if text.is_empty() => refused(" says nothing".into()),
            Self::Filled => Ok(()),
            Self::Bytes => {
                let number = text.trim().trim_end_matches(|c: char| "KMGTPE".contains(c.to_ascii_uppercase()));
                let right =
                    text.trim().len() <= number.len() + 1 && number.parse::<u64>().is_ok() || text.trim() == "-1";
                if right {
                    Ok(())
                } else {
                    refused(": it is a whole number, perhaps with one of K, M, G, T, P, E".into())
                }
            }
            Self::Numbers { kind, least, most, bound } => {
                let mut count = 0;
                let mut first = f64::NAN;
                for word in text.split_whitespace() {
                    let Some(x) = kind.number(word) else {
                        return refused(format!(": `{}` is no {}", brief(word), kind.words()));
                    };
                    (first, count) = (if count == 0 { x } else { first }, count + 1);
                }
                // An empty list has no effect.
                if count > 0 && !(*least..=*most).contains(&count) {
                    let needed = if least == most { least.to_string() } else { format!("{least} to {most}") };
                    return refused(format!(
                        " has {count} number{}; {needed} are needed",
                        if count == 1 { "" } else { "s" }
                    ));
                }
                let Some((sign, x)) = bound.filter(|_| count > 0) else { return Ok(()) };
                let wrong = match sign {
                    ">" => first <= x,
                    ">=" => first < x,
                    "<" => first >= x,
                    _ => first != x,
                };
                if wrong { refused(format!(": it has to be {sign} {x}")) } else { Ok(()) }
            }
            Self::Words("word", known) if known.contains(&text) => Ok(()),
            Self::Words("word", known) => refused(format!(": it is one of {}", known.join(", "))),
            Self::Words(how, known) => {
                let places = text.split_whitespace().map(|word| known.iter().position(|own| *own == word));
                let Some(places) = places.collect::<Option<Vec<_>>>() else {
                    return refused(format!(": it is some of {}", known.join(", ")));
                };
                let twice = places.iter().enumerate().any(|(k, place)| places[..k].contains(place));
                if twice || *how == "ordered" && !places.is_sorted() {
                    return refused(format!(": each once, in this order: {}", known.join(", ")));
                }
                Ok(())
            }
        }
    }
}

impl Number {
    fn number(self, word: &str) -> Option<f64> {
        let x = if self == Self::Whole { word.parse::<i32>().ok()?.into() } else { word.parse::<f64>().ok()? };
        let most = if self == Self::Single { f64::from(f32::MAX) } else { f64::MAX };
        // An explicit infinity is allowed, but not an overflow.
        (!x.is_finite() && !word.contains(|c: char| c.is_ascii_digit()) || x.abs() <= most)
            .then_some(if self == Self::Single { f64::from(x as f32) } else { x })
    }

    fn words(self) -> &'static str {
        match self {
            Self::Real => "number",
            Self::Single => "number of single precision",
            Self::Whole => "whole number of 32 bits",
        }
    }
}
