//! Formulas of a task's file.

use std::ops::Range;

use nerd_sim::prelude::*;

use super::expression::{Part, Reader};
use super::keys::{Keys, Terms};
use super::words::Facts;
use crate::formula::{Program, Tape, Traced};

/// The formulas of a file.
pub(super) struct Formulas {
    pub(super) observe: Program,
    /// Torques of an action.
    pub(super) act: Program,
    /// Reward, followed by its terms; the names of these terms.
    pub(super) reward: Program,
    pub(super) terms: Vec<String>,
    /// End of the episode.
    pub(super) terminated: Program,
    /// Error divided by the tolerance.
    pub(super) error: Program,
}

impl Formulas {
    /// Refuses a wrong number of torques, and a reward without terms.
    pub(super) fn check(&self, system: &System) -> Result<(), String> {
        let joints = system.robot.joint_count();
        let torques = self.act.out.len();
        if torques != joints {
            return Err(format!("act: it has {torques} torques, and `{}` has {joints} joints", system.name));
        }
        if self.reward.out.is_empty() {
            return Err("reward: it has no term".into());
        }
        Ok(())
    }

    /// How many numbers of memory follow a goal: none, the last action, or two actions and what else is read.
    pub(super) fn memory(&self, goal: usize, actions: usize) -> usize {
        let read = [&self.observe, &self.act, &self.reward, &self.terminated, &self.error].map(Program::goals);
        let last = read.into_iter().max().unwrap_or(0).saturating_sub(goal);
        if last > 2 * actions {
            last
        } else if last > 0 {
            2 * actions
        } else {
            0
        }
    }
}

/// An expression and its name under a key; the name is empty for a single expression.
type Own = (String, String);

/// What the formulas of a file are read with. `goal`: numbers in the goal.
pub(super) struct Read<'a> {
    pub(super) facts: &'a Facts,
    pub(super) keys: &'a Keys,
    pub(super) commands: &'a [(String, Range<usize>)],
    pub(super) actions: usize,
    pub(super) goal: usize,
}

impl Read<'_> {
    pub(super) fn formulas(&self) -> Result<Formulas, String> {
        let keys = self.keys;
        // Check each name of [let] alone, so that unused names are checked too.
        for name in keys.lets.keys() {
            self.vector(Part::Reward, "let", &[(name.clone(), name.clone())])?;
        }
        let counted = keys.observation.iter().enumerate().map(|(k, text)| (k.to_string(), text.clone()));
        let usual = Some("controlled(action)".to_string());
        let observe = self.vector(Part::Other, "observation", &counted.collect::<Vec<_>>())?;
        let act = self.vector(Part::Act, "act", &alone(&keys.act.clone().or(usual)))?;
        let (reward, terms) = self.reward()?;
        Ok(Formulas { observe, act, reward, terms, terminated: self.terminated()?, error: self.error()? })
    }

    fn reader<'t>(&'t self, tape: &'t Tape, part: Part) -> Reader<'t> {
        Reader::new(tape, self.facts, part, &self.keys.lets, self.commands, self.actions, self.goal)
    }

    /// A formula of all numbers of its expressions.
    fn vector(&self, part: Part, key: &str, all: &[Own]) -> Result<Program, String> {
        let tape = Tape::default();
        let reader = self.reader(&tape, part);
        let mut out: Vec<Traced> = Vec::new();
        for (own, text) in all {
            out.extend(reader.read(&place(key, own), text)?);
        }
        Ok(Program::reduced(&tape, &out))
    }

    /// The reward and its terms, and the names of these terms.
    fn reward(&self) -> Result<(Program, Vec<String>), String> {
        let all = match &self.keys.reward {
            Terms::One(text) => vec![(String::new(), text.clone())],
            Terms::Sum(terms) => terms.clone().into_iter().collect(),
        };
        let tape = Tape::default();
        let reader = self.reader(&tape, Part::Reward);
        let out = scalars(&reader, "reward", &all)?;
        // If the reward is a single expression, its terms are the names of [let] that it refers to.
        let own = if let [(name, _)] = &all[..]
            && name.is_empty()
        {
            reader.names()
        } else {
            all.iter().map(|own| own.0.clone()).zip(out.iter().copied()).collect()
        };
        let (names, values): (Vec<_>, Vec<_>) = own.into_iter().unzip();
        let out: Vec<_> = out.into_iter().reduce(|a, b| a + b).into_iter().chain(values).collect();
        Ok((Program::reduced(&tape, &out), names))
    }

    fn terminated(&self) -> Result<Program, String> {
        let tape = Tape::default();
        let reader = self.reader(&tape, Part::Other);
        Ok(Program::reduced(&tape, &scalars(&reader, "terminated", &alone(&self.keys.terminated))?))
    }

    fn error(&self) -> Result<Program, String> {
        let tape = Tape::default();
        let reader = self.reader(&tape, Part::Other);
        let mut out = scalars(&reader, "error", &alone(&self.keys.error))?;
        let tolerance = self.keys.tolerance.0;
        if tolerance != 1.0 {
            let share = Traced::from(tolerance.recip());
            out.iter_mut().for_each(|error| *error = *error * share);
        }
        Ok(Program::reduced(&tape, &out))
    }
}

fn alone(text: &Option<String>) -> Vec<Own> {
    text.iter().map(|text| (String::new(), text.clone())).collect()
}

/// Place of an expression in the file.
fn place(key: &str, own: &str) -> String {
    if own.is_empty() { key.to_string() } else { format!("{key}.{own}") }
}

/// One number of each expression.
fn scalars<'a>(reader: &Reader<'a>, key: &str, all: &[Own]) -> Result<Vec<Traced<'a>>, String> {
    all.iter().map(|(own, text)| reader.one(&place(key, own), text)).collect()
}
