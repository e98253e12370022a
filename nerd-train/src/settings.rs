//! Settings with the same keys in TOML files and on the command line. The macro `settings!` declares help, range and
//! default of each key once; [`Settings::keys`] lists them.

use itertools::Itertools;
use std::ops::RangeInclusive;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// Keys of settings, with their values.
pub type Given = Map<String, Value>;

/// A key of settings, with its help text and range.
#[derive(Debug)]
pub struct Key {
    #[doc(hidden)]
    pub field: &'static str,
    #[doc(hidden)]
    pub doc: &'static str,
    /// Type and range of the value.
    pub values: Values,
    /// Heading above the key in the help text; empty without one.
    pub heading: &'static str,
    #[doc(hidden)]
    pub wanted: &'static str,
}

impl Key {
    /// Name in a file, and on the command line after `--`.
    pub fn name(&self) -> String {
        self.field.replace('_', "-")
    }

    /// Kind of value, as the help text shows it, for example `FRAMES` or `FOLDER`.
    pub fn wanted(&self) -> String {
        match self.values {
            _ if !self.wanted.is_empty() => self.wanted.into(),
            Values::Whole(_) => "N".into(),
            Values::Wholes(_) => "N,...".into(),
            Values::Number(_) | Values::Positive(_) => "NUMBER".into(),
            _ => self.name().to_uppercase(),
        }
    }

    /// Meaning of the key, without a final full stop.
    pub fn help(&self) -> &'static str {
        self.doc.trim().trim_end_matches('.')
    }
}

/// Type and range of a key's value.
#[derive(Clone, Debug)]
pub enum Values {
    /// Yes or no.
    Flag,
    /// A text that is not empty: a name, a path.
    Text,
    /// Texts; on a command line comma-separated (see [`listed`]), or the option several times.
    Texts,
    /// Texts that this function accepts.
    Read(fn(&str) -> Result<(), String>),
    /// One of these words.
    Words(&'static [&'static str]),
    /// A whole number in a range.
    Whole(RangeInclusive<u64>),
    /// Whole numbers in a range; on a command line comma-separated.
    Wholes(RangeInclusive<u64>),
    /// A finite number in a range.
    Number(RangeInclusive<f64>),
    /// A number above 0, up to a maximum.
    Positive(f64),
}

impl Values {
    /// Parses and checks a value from the command line. The error names the expected values.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let value = match self {
            Self::Flag => text.parse().map_or(Value::Null, Value::Bool),
            Self::Text | Self::Words(_) => text.into(),
            Self::Texts | Self::Read(_) => listed(text).into(),
            Self::Whole(_) => text.parse::<u64>().map_or(Value::Null, Value::from),
            Self::Wholes(_) => {
                text.split(',').map(|part| part.parse::<u64>().map_or(Value::Null, Value::from)).collect()
            }
            Self::Number(_) | Self::Positive(_) => text.parse::<f64>().map_or(Value::Null, Value::from),
        };
        self.check(&value).map(|()| value)
    }

    /// Checks type and range of a value; NaN and infinities fail. The error names the expected values.
    pub fn check(&self, value: &Value) -> Result<(), String> {
        let text = |v: &Value| v.as_str().is_some_and(|s| !s.is_empty());
        let (good, needed) = match self {
            Self::Flag => (value.is_boolean(), "true or false is needed".into()),
            Self::Text => (text(value), "a text is needed".into()),
            Self::Texts => {
                (value.as_array().is_some_and(|all| all.iter().all(text)), "a list of texts is needed".into())
            }
            Self::Read(read) => {
                let all = value.as_array().filter(|all| all.iter().all(text));
                let wrong = all.into_iter().flatten().filter_map(Value::as_str).find_map(|text| read(text).err());
                (all.is_some() && wrong.is_none(), wrong.unwrap_or_else(|| "a list of texts is needed".into()))
            }
            Self::Words(words) => {
                (value.as_str().is_some_and(|s| words.contains(&s)), format!("one of {} is needed", words.join(", ")))
            }
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
                let within = if *range == (f64::MIN..=f64::MAX) {
                    String::new()
                } else {
                    format!(" from {} to {}", range.start(), range.end())
                };
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

/// Splits a comma-separated list outside brackets. An existing path with commas in its name stays one part.
pub fn listed(text: &str) -> Vec<String> {
    let mut depth = 0;
    let outside = |c: char| {
        depth += i32::from(c == '(') - i32::from(c == ')');
        c == ',' && depth <= 0
    };
    let parts = text.split(outside).collect_vec();
    let mut found = Vec::new();
    let mut from = 0;
    while from < parts.len() {
        let there = |to: &usize| std::path::Path::new(&parts[from..*to].join(",")).exists();
        let to = (from + 2..=parts.len()).rev().find(there).unwrap_or(from + 1);
        found.push(parts[from..to].join(","));
        from = to;
    }
    found
}

/// A struct of settings, made by `settings!`.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// All keys, including those of a shared struct.
    fn keys() -> Vec<&'static Key>;

    /// Keys with their values; an unset option is null.
    fn given(&self) -> Given {
        match serde_json::to_value(self) {
            Ok(Value::Object(all)) => all,
            _ => Given::new(),
        }
    }

    /// These settings, overridden by `given`. The error is one line about the first wrong key.
    fn with(&self, given: &Given) -> Result<Self, String> {
        let mut all = self.given();
        for (name, value) in given {
            let Some(key) = Self::keys().into_iter().find(|key| key.name() == *name) else {
                let known = Self::keys().iter().map(|k| k.name()).collect_vec();
                return Err(format!("`{name}` is not a setting; choose from {}", known.join(", ")));
            };
            key.values.check(value).map_err(|needed| format!("`{name}` is {value}: {needed}"))?;
            all.insert(name.clone(), value.clone());
        }
        serde_json::from_value(all.into()).map_err(|e| e.to_string())
    }
}

/// Declares a struct of settings: `/// help`, `key: type = default, values, "WANTED";`, where WANTED is the kind of
/// value that a help shows, by default the key. `# "Heading"` heads the keys below it. The first field may be a struct
/// of settings shared with other structs, after `..`.
#[doc(hidden)]
#[macro_export]
macro_rules! settings {
    (
        $(#[doc = $about:literal])+
        pub struct $name:ident {
            $( .. $(#[doc = $shared_doc:literal])+ $shared:ident: $shared_type:ty; )?
            $( # $heading:literal
                $( $(#[doc = $doc:literal])+ $field:ident: $type:ty = $default:expr, $values:expr $(, $wanted:literal)?; )+
            )+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
        #[non_exhaustive]
        pub struct $name {
            $( $(#[doc = $shared_doc])+ #[serde(flatten)] pub $shared: $shared_type, )?
            $( $( $(#[doc = $doc])+ pub $field: $type, )+ )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $shared: Default::default(), )? $( $( $field: $default, )+ )+ }
            }
        }

        impl $crate::settings::Settings for $name {
            fn keys() -> Vec<&'static $crate::settings::Key> {
                use $crate::settings::{Key, Values::*};
                const OWN: &[Key] = &[$( $( Key {
                    field: stringify!($field),
                    doc: concat!($($doc),+),
                    values: $values,
                    heading: $heading,
                    wanted: concat!($($wanted)?),
                } ),+ ),+];
                let all = OWN.iter();
                $( let all = all.chain(<$shared_type as $crate::settings::Settings>::keys()); )?
                all.collect()
            }
        }
    };
    (
        $(#[doc = $about:literal])+
        pub struct $name:ident {
            $( .. $(#[doc = $shared_doc:literal])+ $shared:ident: $shared_type:ty; )?
            $( $(#[doc = $doc:literal])+ $field:ident: $type:ty = $default:expr, $values:expr $(, $wanted:literal)?; )+
        }
    ) => {
        $crate::settings::settings! {
            $(#[doc = $about])+
            pub struct $name {
                $( .. $(#[doc = $shared_doc])+ $shared: $shared_type; )?
                # ""
                $( $(#[doc = $doc])+ $field: $type = $default, $values $(, $wanted)?; )+
            }
        }
    };
}
pub use settings;
