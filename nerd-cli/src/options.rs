//! Settings of the libraries as command-line options, with names, help, ranges and defaults.

use std::marker::PhantomData;

use anyhow::{Error, Result};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Command, parser::ValueSource};
use nerd_train::settings::{Given, Key, Settings, Values};
use serde::de::DeserializeOwned;
use serde_json::Value;

pub use nerd_train::bounds::{FRAMES, MINUTES, SEEDS, STARTS, SUBSTEPS, TRANSITIONS};
pub use nerd_train::settings::Values::{Positive, Whole};

pub const DEVICES: &[&str] = &["cpu", "cuda"];
/// Devices of models. With `cuda`, matrix products are f16 if one kernel computes the network; with `cuda-f32`, never.
pub const MODELS: &[&str] = &["cpu", "cuda", "cuda-f32"];
pub const TRUTHS: &[&str] = &["articulated", "paper", "rapier"];

/// Parses an option's value with the checks of a setting.
pub fn value<T: DeserializeOwned>(
    values: Values,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| serde_json::from_value(values.parse(text)?).map_err(|e| e.to_string())
}

pub fn word<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    words: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(words).try_map(|word| serde_json::from_value::<T>(word.into()))
}

pub fn arguments(keys: Vec<&'static Key>, defaults: &Given) -> Vec<Arg> {
    let option = |key: &'static Key| {
        let name = key.name();
        let default = defaults.get(&name).filter(|v| v.is_number() || v.as_str().is_some_and(|s| !s.is_empty()));
        let default =
            default.map(|value| format!(" [default: {}]", value.to_string().trim_matches('"'))).unwrap_or_default();
        let arg = Arg::new(name.clone()).long(name).help(format!("{}{default}", key.help())).value_name(key.wanted());
        let arg = if key.heading.is_empty() { arg } else { arg.help_heading(key.heading) };
        let arg = arg.value_parser(value::<Value>(key.values.clone()));
        match key.values {
            Values::Words(words) => arg.value_parser(PossibleValuesParser::new(words).map(Value::from)),
            Values::Flag => arg.action(ArgAction::Set).num_args(0).default_missing_value("true"),
            Values::Texts | Values::Read(_) => arg.action(ArgAction::Append),
            _ => arg,
        }
    };
    keys.into_iter().map(option).collect()
}

/// Returns the values of those settings that the command line gives, by name.
pub fn given(keys: Vec<&'static Key>, matches: &ArgMatches) -> Given {
    let one = |key: &Key| {
        let name = key.name();
        let all = matches
            .get_many::<Value>(&name)
            .filter(|_| matches.value_source(&name) == Some(ValueSource::CommandLine))?;
        // Appends the values of an option that is repeated and takes a list.
        let join = |mut first: Value, next: Value| match (&mut first, next) {
            (Value::Array(first), Value::Array(mut next)) => {
                first.append(&mut next);
                Value::Array(std::mem::take(first))
            }
            (_, next) => next,
        };
        Some((name, all.cloned().reduce(join)?))
    };
    keys.into_iter().filter_map(one).collect()
}

pub struct Keys<T> {
    pub given: Given,
    of: PhantomData<T>,
}

impl<T: Settings> Keys<T> {
    pub fn settings(&self) -> Result<T> {
        T::default().with(&self.given).map_err(Error::msg)
    }
}

impl<T: Settings> clap::FromArgMatches for Keys<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self { given: given(T::keys(), matches), of: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        self.given.append(&mut given(T::keys(), matches));
        Ok(())
    }
}

impl<T: Settings> clap::Args for Keys<T> {
    fn augment_args(command: Command) -> Command {
        command.args(arguments(T::keys(), &T::default().given()))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}
