//! A task from a file, for one robot.

use std::collections::HashSet;
use std::ops::Range;
use std::sync::Mutex;

use nerd_sim::files::renamed::{self, Kind};
use nerd_sim::prelude::*;
use nerd_sim::range::within;
use nerd_sim::system::{SystemError, TERRAIN};

use super::commands::{commands, levels, names, ranges};
use super::formulas::{Formulas, Read};
use super::keys::Keys;
use super::words::Facts;
use crate::formula::{Sight, Traced};
use crate::{About, Task, TaskError};

/// A task read from a file, for one robot.
pub struct FileTask {
    about: About,
    system: Arc<System>,
    text: String,
    goal: Vec<[f64; 2]>,
    /// Names of the goal's leading numbers, the commands.
    names: Vec<String>,
    place: bool,
    keys: Keys,
    formulas: Formulas,
    memory: usize,
    levels: Option<(usize, usize)>,
}

impl FileTask {
    /// Reads the text of a file, for `robot` ([`System::named`]) or for the file's default robot; `name` is the task's
    /// name.
    ///
    /// # Errors
    /// If the text is invalid (the error names key and column), or the robot or scene is unknown.
    pub fn new(name: &str, text: &str, robot: Option<&str>) -> Result<Self, TaskError> {
        let wrong = |said: String| TaskError::File(name.into(), said);
        let (keys, mut old) = parse(text).map_err(wrong)?;
        let Some(robot) = robot.or(keys.robot.as_deref()) else {
            return Err(wrong("it is for any robot: name one with --robot, or under the key `robot`".into()));
        };
        check(&keys).map_err(wrong)?;
        let system = keys.fit(System::named(robot)?)?;
        if system.robot.joint_count() == 0 && keys.act.is_none() {
            return Err(wrong(format!("`{}` has no joint that moves: there is nothing to act with", system.name)));
        }
        levels(&keys).map_err(wrong)?;
        ranges(&keys).map_err(wrong)?;
        let scene = scene(&system, &keys)?;
        let facts = Facts::new(&system, &scene, system.frame_time * keys.frames as f64);
        let actions = keys.actions.unwrap_or(system.robot.joint_count());
        within("actions", actions as f64, 1.0..=4096.0, "").map_err(wrong)?;
        let (goal, commands, place) = commands(&keys);
        names(&facts, &keys, &commands).map_err(wrong)?;
        let read = Read { facts: &facts, keys: &keys, commands: &commands, actions, goal: goal.len() };
        let formulas = read.formulas().map_err(wrong)?;
        formulas.check(&system).map_err(wrong)?;
        let about = About {
            name: kept(name),
            robot: kept(robot),
            scene: kept(&scene.name),
            observation: formulas.observe.out.len(),
            action: actions,
            steps: keys.steps,
            frames: keys.frames,
        };
        about.check().map_err(wrong)?;
        old.extend(facts.old.take());
        renamed::note(&format!("task {name}"), old);
        Ok(Self {
            about,
            system,
            text: text.into(),
            names: numbered(&commands),
            place,
            memory: formulas.memory(goal.len(), actions),
            levels: keys.levels.map(|levels| (goal.len() - 2, levels)),
            formulas,
            goal,
            keys,
        })
    }
}

/// Reads the keys of a file's text. Also returns the notes on renamed keys.
fn parse(text: &str) -> Result<(Keys, Vec<renamed::Renamed>), String> {
    let (read, old) = renamed::toml(Kind::Task, text)?;
    let keys = toml::from_str(&read).map_err(|e| match e.message() {
        // toml's error for a missing field has no useful place in the text.
        missing if missing.starts_with("missing field") && e.span().is_none_or(|span| span.start == 0) => {
            missing.into()
        }
        _ => e.to_string().trim().replace('\n', " "),
    })?;
    Ok((keys, old))
}

/// Refuses keys that are invalid for every robot.
fn check(keys: &Keys) -> Result<(), String> {
    if let Some(terrain) = &keys.terrain {
        if keys.scene.is_some() {
            return Err("scene: [terrain] is the scene; leave one of the two out".into());
        }
        terrain.check().map_err(|e| format!("terrain: {e}"))?;
    }
    keys.frame_time.map_or(Ok(()), |time| within("frame_time", time, 1e-6..=1.0, "s"))
}

/// The file's scene, or its terrain, or else the robot's.
fn scene(system: &System, keys: &Keys) -> Result<Arc<Scene>, SystemError> {
    let ground = keys.terrain.map(|_| TERRAIN.into()).or_else(|| system.spec.data_scene.clone());
    let usual = ground.unwrap_or_else(|| "free".into());
    system.scene(keys.scene.as_ref().unwrap_or(&usual))
}

/// Name of each number of the commands.
fn numbered(commands: &[(String, Range<usize>)]) -> Vec<String> {
    let named = commands.iter().flat_map(|(name, at)| {
        at.clone().map(move |k| if at.len() > 1 { format!("{name}[{}]", k - at.start) } else { name.clone() })
    });
    named.collect()
}

/// Returns the text with static lifetime; equal texts share one copy, which is never freed.
fn kept(text: &str) -> &'static str {
    static KEPT: Mutex<Option<HashSet<&'static str>>> = Mutex::new(None);
    let mut kept = KEPT.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let kept = kept.get_or_insert_default();
    if let Some(known) = kept.get(text) {
        return known;
    }
    let text: &'static str = Box::leak(text.into());
    kept.insert(text);
    text
}

impl Task for FileTask {
    fn about(&self) -> About {
        self.about
    }

    fn system(&self) -> Result<Arc<System>, SystemError> {
        Ok(self.system.clone())
    }

    fn fit(&self, robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        self.keys.fit(robot)
    }

    fn text(&self) -> Option<&str> {
        Some(&self.text)
    }

    fn goal(&self) -> &[[f64; 2]] {
        &self.goal
    }

    fn commands(&self) -> Vec<(String, [f64; 2])> {
        self.names.iter().cloned().zip(self.goal.iter().copied()).collect()
    }

    fn place(&self) -> bool {
        self.place
    }

    fn levels(&self) -> Option<(usize, usize)> {
        self.levels
    }

    fn memory(&self) -> usize {
        self.memory
    }

    fn controlled(&self) -> bool {
        self.formulas.act.controlled()
    }

    fn tolerance(&self) -> (f64, &str) {
        (self.keys.tolerance.0, &self.keys.tolerance.1)
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out.copy_from_slice(&self.formulas.observe.replay(sight.tape, &[], &[]));
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        torques.copy_from_slice(&self.formulas.act.replay(sight.tape, action, &[]));
    }

    fn reward<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Traced<'a> {
        self.rewards(sight, torques)[0]
    }

    fn terms(&self) -> &[String] {
        &self.formulas.terms
    }

    fn rewards<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Vec<Traced<'a>> {
        self.formulas.reward.replay(sight.tape, &[], torques)
    }

    fn error<'a>(&self, sight: &Sight<'a>) -> Option<Traced<'a>> {
        self.formulas.error.replay(sight.tape, &[], &[]).first().copied()
    }

    fn terminated<'a>(&self, sight: &Sight<'a>) -> Traced<'a> {
        self.formulas.terminated.replay(sight.tape, &[], &[]).first().copied().unwrap_or(0.0.into())
    }
}
