//! Settings with the same keys in a TOML file and on the command line. Each key's help, range and default are written once, in `settings!`;
//! [`Settings::keys`] lists them.

use std::ops::RangeInclusive;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// Keys with their values.
pub type Given = Map<String, Value>;

/// One key.
#[derive(Debug)]
pub struct Key {
    #[doc(hidden)]
    pub field: &'static str,
    #[doc(hidden)]
    pub doc: &'static str,
    /// What it may be.
    pub values: Values,
}

impl Key {
    /// Its name in a file, and behind `--`.
    pub fn name(&self) -> String {
        self.field.replace('_', "-")
    }

    /// What it means.
    pub fn help(&self) -> &'static str {
        self.doc.trim().trim_end_matches('.')
    }
}

/// What a key may be.
#[derive(Clone, Debug)]
pub enum Values {
    /// Yes or no.
    Flag,
    /// A text: a name, a path.
    Text,
    /// Texts; on a command line with commas between, see [`listed`], or the option several times.
    Texts,
    /// One of some words.
    Words(&'static [&'static str]),
    /// A whole number within a range.
    Whole(RangeInclusive<u64>),
    /// Whole numbers within a range; on a command line with commas between.
    Wholes(RangeInclusive<u64>),
    /// A number within a range.
    Number(RangeInclusive<f64>),
    /// A number above 0, up to this.
    Positive(f64),
}

impl Values {
    /// A value as a command line says it.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let value = match self {
            Self::Flag => text.parse().map_or(Value::Null, Value::Bool),
            Self::Text | Self::Words(_) => text.into(),
            Self::Texts => listed(text).into(),
            Self::Whole(_) => text.parse::<u64>().map_or(Value::Null, Value::from),
            Self::Wholes(_) => text.split(',').map(|part| part.parse::<u64>().map_or(Value::Null, Value::from)).collect(),
            Self::Number(_) | Self::Positive(_) => text.parse::<f64>().map_or(Value::Null, Value::from),
        };
        self.check(&value).map(|()| value)
    }

    /// Refuses what is not among them. No number that is not finite is.
    pub fn check(&self, value: &Value) -> Result<(), String> {
        let text = |v: &Value| v.as_str().is_some_and(|s| !s.is_empty());
        let (good, needed) = match self {
            Self::Flag => (value.is_boolean(), "true or false is needed".into()),
            Self::Text => (text(value), "a text is needed".into()),
            Self::Texts => (value.as_array().is_some_and(|all| all.iter().all(text)), "a list of texts is needed".into()),
            Self::Words(words) => (value.as_str().is_some_and(|s| words.contains(&s)), format!("one of {} is needed", words.join(", "))),
            Self::Whole(range) => {
                let needed = format!("a whole number from {} to {} is needed", range.start(), range.end());
                (value.as_u64().is_some_and(|n| range.contains(&n)), needed)
            }
            Self::Wholes(range) => {
                let whole = |v: &Value| v.as_u64().is_some_and(|n| range.contains(&n));
                let needed = format!("whole numbers from {} to {} are needed", range.start(), range.end());
                (value.as_array().is_some_and(|all| !all.is_empty() && all.iter().all(whole)), needed)
            }
            Self::Number(range) => {
                let within =
                    if *range == (f64::MIN..=f64::MAX) { String::new() } else { format!(" from {} to {}", range.start(), range.end()) };
                let needed = format!("a {}number{within} is needed", if within.is_empty() { "finite " } else { "" });
                (value.as_f64().is_some_and(|x| range.contains(&x)), needed)
            }
            Self::Positive(most) => {
                let needed = format!("a number above 0, up to {most}, is needed");
                (value.as_f64().is_some_and(|x| x > 0.0 && x <= *most), needed)
            }
        };
        if good { Ok(()) } else { Err(needed) }
    }
}

/// Texts between commas. What is a file or a folder with commas in its name is one of them.
pub fn listed(text: &str) -> Vec<String> {
    let parts: Vec<&str> = text.split(',').collect();
    let (mut found, mut from) = (Vec::new(), 0);
    while from < parts.len() {
        let there = |to: &usize| std::path::Path::new(&parts[from..*to].join(",")).exists();
        let to = (from + 2..=parts.len()).rev().find(there).unwrap_or(from + 1);
        found.push(parts[from..to].join(","));
        from = to;
    }
    found
}

/// A struct of settings; `settings!` makes it.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// All its keys.
    fn keys() -> Vec<&'static Key>;

    /// As keys with their values; what is not set is null.
    fn given(&self) -> Given {
        match serde_json::to_value(self) {
            Ok(Value::Object(all)) => all,
            _ => Given::new(),
        }
    }

    /// These settings, but for those that are given.
    fn with(&self, given: &Given) -> Result<Self, String> {
        let mut all = self.given();
        for (name, value) in given {
            let Some(key) = Self::keys().into_iter().find(|key| key.name() == *name) else {
                let known: Vec<String> = Self::keys().iter().map(|k| k.name()).collect();
                return Err(format!("`{name}` is not a setting; choose from {}", known.join(", ")));
            };
            key.values.check(value).map_err(|needed| format!("`{name}` is {value}: {needed}"))?;
            all.insert(name.clone(), value.clone());
        }
        serde_json::from_value(all.into()).map_err(|e| e.to_string())
    }
}

/// Declares a struct of settings: `/// meaning`, `key: type = default, values;`, and in front of them, if there is one, a struct
/// of settings that it has in common with others.
#[doc(hidden)]
#[macro_export]
macro_rules! settings {
    (
        $(#[doc = $about:literal])+
        pub struct $name:ident {
            $( .. $(#[doc = $shared_doc:literal])+ $shared:ident: $shared_type:ty; )?
            $( $(#[doc = $doc:literal])+ $field:ident: $type:ty = $default:expr, $values:expr; )+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
        #[non_exhaustive]
        pub struct $name {
            $( $(#[doc = $shared_doc])+ #[serde(flatten)] pub $shared: $shared_type, )?
            $( $(#[doc = $doc])+ pub $field: $type, )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $shared: Default::default(), )? $( $field: $default, )+ }
            }
        }

        impl $crate::settings::Settings for $name {
            fn keys() -> Vec<&'static $crate::settings::Key> {
                use $crate::settings::{Key, Values::*};
                const OWN: &[Key] =
                    &[$( Key { field: stringify!($field), doc: concat!($($doc),+), values: $values } ),+];
                let all = OWN.iter();
                $( let all = all.chain(<$shared_type as $crate::settings::Settings>::keys()); )?
                all.collect()
            }
        }
    };
}
pub use settings;
