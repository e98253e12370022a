//! Settings of the libraries as options of the command line: names, help, ranges and defaults are theirs.

use std::marker::PhantomData;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Command, Error, parser::ValueSource};
use nerd_train::settings::{Given, Settings, Values};
use serde_json::Value;

/// Those of `T` that a command line gave.
#[derive(Clone, Debug)]
pub struct Keys<T> {
    /// By key.
    pub given: Given,
    of: PhantomData<T>,
}

impl<T: Settings> clap::FromArgMatches for Keys<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut given = Given::new();
        for key in T::keys() {
            let name = key.name();
            if matches.value_source(&name) == Some(ValueSource::CommandLine)
                && let Some(value) = matches.get_one::<Value>(&name)
            {
                given.insert(name, value.clone());
            }
        }
        Ok(Self { given, of: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        self.given.append(&mut Self::from_arg_matches(matches)?.given);
        Ok(())
    }
}

impl<T: Settings> clap::Args for Keys<T> {
    fn augment_args(command: Command) -> Command {
        let defaults = T::default().given();
        let option = |key: &'static nerd_train::settings::Key| {
            let name = key.name();
            let default = defaults.get(&name).filter(|v| v.is_number() || v.as_str().is_some_and(|s| !s.is_empty()));
            let help = match default {
                Some(value) => format!("{} [default: {}]", key.help(), value.to_string().trim_matches('"')),
                None => key.help().to_string(),
            };
            let values = key.values.clone();
            let arg = Arg::new(name.clone()).long(name.clone()).help(help).value_name(name.to_uppercase());
            let arg = match key.values {
                Values::Words(words) => arg.value_parser(PossibleValuesParser::new(words).map(Value::from)),
                _ => arg.value_parser(move |text: &str| values.parse(text)),
            };
            if matches!(key.values, Values::Flag) { arg.action(ArgAction::Set).num_args(0).default_missing_value("true") } else { arg }
        };
        command.args(T::keys().into_iter().map(option))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}
