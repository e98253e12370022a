//! Commands and names of a task's file.

use std::ops::Range;

use nerd_sim::range::within;

use super::keys::{Keys, Terms};
use super::words::Facts;
use crate::formula::Tape;

/// Ranges of the goal's numbers; the position of each command in the goal; whether the goal's first three numbers are a
/// `target` to be displayed.
pub(super) type Commands = (Vec<[f64; 2]>, Vec<(String, Range<usize>)>, bool);

pub(super) fn commands(keys: &Keys) -> Commands {
    let mut goal = Vec::new();
    let mut places = Vec::new();
    let target = |name: &String| name == "target";
    for (name, command) in
        keys.command.iter().filter(|c| target(c.0)).chain(keys.command.iter().filter(|c| !target(c.0)))
    {
        let ranges = &command.0;
        places.push((name.clone(), goal.len()..goal.len() + ranges.len()));
        goal.extend(ranges.iter().map(|range| [range.low, range.high]));
    }
    if keys.levels.is_some() {
        places.push(("level".into(), goal.len()..goal.len() + 1));
        goal.extend([[1.0; 2], [0.0; 2]]);
    }
    let place = places.first().is_some_and(|(name, at)| target(name) && at.len() == 3);
    (goal, places, place)
}

/// Refuses levels without a terrain or an error, and a command named like the word that they add.
pub(super) fn levels(keys: &Keys) -> Result<(), String> {
    let Some(levels) = keys.levels else { return Ok(()) };
    let of = (keys.terrain.is_some(), keys.error.is_some(), keys.command.contains_key("level"));
    match of {
        (true, true, false) => within("levels", levels as f64, 2.0..=1000.0, ""),
        (_, _, true) => Err("command.level: with levels that is a word; choose another name".into()),
        _ => Err("levels: an episode that succeeds by `error` goes on to higher [terrain]; both are needed".into()),
    }
}

/// Largest magnitude of a command (SI units), and largest number of scalars in all commands together.
const FAR: f64 = 1e6;
const COMMANDS: f64 = 4096.0;

/// Refuses commands that are too many or too far.
pub(super) fn ranges(keys: &Keys) -> Result<(), String> {
    within(
        "numbers of [command]",
        keys.command.values().map(|command| command.0.len()).sum::<usize>() as f64,
        0.0..=COMMANDS,
        "",
    )?;
    let all = keys.command.iter().flat_map(|(name, command)| command.0.iter().map(move |range| (name, range)));
    for (name, range) in all {
        let end = |x| within(format!("command.{name} is {range}; an end"), x, -FAR..=FAR, "");
        end(range.low).and_then(|()| end(range.high))?;
    }
    Ok(())
}

/// Refuses names of commands, definitions and reward terms that are in use already, or are not identifiers.
pub(super) fn names(facts: &Facts, keys: &Keys, commands: &[(String, Range<usize>)]) -> Result<(), String> {
    let all = commands.iter().map(|c| (&c.0, "command")).chain(keys.lets.keys().map(|name| (name, "let")));
    let terms = if let Terms::Sum(terms) = &keys.reward { Some(terms.keys()) } else { None };
    for (name, table) in all.chain(terms.into_iter().flatten().map(|name| (name, "reward"))) {
        let said = format!("{table}.{}", name.escape_debug());
        if syn::parse_str::<syn::Ident>(name).is_err() {
            return Err(format!("{said}: a name has letters, digits and `_`, and no digit first"));
        }
        // Names of reward terms appear only in results, so they may equal words.
        if table == "reward" {
            continue;
        }
        if ["action", "last_action", "time", "torque"].contains(&name.as_str())
            || facts.word(&Tape::default(), name).is_some()
        {
            return Err(format!("{said}: there is a word `{name}`; choose another name"));
        }
        if table == "let" && keys.command.contains_key(name) {
            return Err(format!("{said}: there is a command `{name}`; choose another name"));
        }
    }
    Ok(())
}
