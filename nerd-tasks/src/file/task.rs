//! A task from a file, for one robot.

use std::collections::HashSet;
use std::ops::Range;
use std::sync::Mutex;

use nerd_sim::files::renamed::{self, Kind};
use nerd_sim::prelude::*;
use nerd_sim::range::within;
use nerd_sim::system::{SystemError, TERRAIN};

use super::expression::{Part, Reader};
use super::keys::{Keys, Terms};
use super::words::Facts;
use crate::formula::{Program, Sight, Tape, Traced};
use crate::{About, Task, TaskError};

/// A task read from a file, for one robot.
pub struct FileTask {
    about: About,
    system: Arc<System>,
    text: String,
    goal: Vec<[f64; 2]>,
    /// Names of the goal's leading numbers, the commands.
    names: Vec<String>,
    terms: Vec<String>,
    place: bool,
    keys: Keys,
    /// Formulas: observation; torques; reward, followed by its terms; end of the episode; error divided by the
    /// tolerance.
    observe: Program,
    act: Program,
    reward: Program,
    terminated: Program,
    error: Program,
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
        let (read, mut old) = renamed::toml(Kind::Task, text).map_err(wrong)?;
        let keys: Keys = toml::from_str(&read).map_err(|e| match e.message() {
            // toml's error for a missing field has no useful place in the text.
            missing if missing.starts_with("missing field") && e.span().is_none_or(|span| span.start == 0) => {
                wrong(missing.into())
            }
            _ => wrong(e.to_string().trim().replace('\n', " ")),
        })?;
        let Some(robot) = robot.or(keys.robot.as_deref()) else {
            return Err(wrong("it is for any robot: name one with --robot, or under the key `robot`".into()));
        };
        if let Some(terrain) = &keys.terrain {
            if keys.scene.is_some() {
                return Err(wrong("scene: [terrain] is the scene; leave one of the two out".into()));
            }
            terrain.check().map_err(|e| wrong(format!("terrain: {e}")))?;
        }
        keys.frame_time.map_or(Ok(()), |time| within("frame_time", time, 1e-6..=1.0, "s")).map_err(wrong)?;
        let system = keys.fit(System::named(robot)?)?;
        if system.robot.joint_count() == 0 && keys.act.is_none() {
            return Err(wrong(format!("`{}` has no joint that moves: there is nothing to act with", system.name)));
        }
        let ground = keys.terrain.map(|_| TERRAIN.into()).or_else(|| system.spec.data_scene.clone());
        let usual = ground.unwrap_or_else(|| "free".into());
        levels(&keys).map_err(wrong)?;
        ranges(&keys).map_err(wrong)?;
        let scene = system.scene(keys.scene.as_ref().unwrap_or(&usual))?;
        let facts = Facts::new(&system, &scene, system.frame_time * keys.frames as f64);
        let actions = keys.actions.unwrap_or(system.robot.joint_count());
        within("actions", actions as f64, 1.0..=4096.0, "").map_err(wrong)?;
        let (goal, commands, place) = commands(&keys);
        let levels = keys.levels.map(|levels| (goal.len() - 2, levels));
        names(&facts, &keys, &commands).map_err(wrong)?;
        let share = Traced::from(keys.tolerance.0.recip());
        let mut terms = Vec::new();
        let mut read = |part: Part, key: &str, all: &[(String, String)], summed: bool| {
            let tape = Tape::default();
            let reader = Reader::new(&tape, &facts, part, &keys.lets, &commands, actions, goal.len());
            let mut out: Vec<Traced> = Vec::new();
            for (own, text) in all {
                let key = if own.is_empty() { key.to_string() } else { format!("{key}.{own}") };
                out.extend(if summed {
                    vec![reader.one(&key, text).map_err(wrong)?]
                } else {
                    reader.read(&key, text).map_err(wrong)?
                });
            }
            if key == "reward" {
                // If the reward is a single expression, its terms are the names of [let] that it refers to.
                let own = if let [(name, _)] = all
                    && name.is_empty()
                {
                    reader.names()
                } else {
                    all.iter().map(|own| own.0.clone()).zip(out.iter().copied()).collect()
                };
                let (names, values): (Vec<_>, Vec<_>) = own.into_iter().unzip();
                out = out.into_iter().reduce(|a, b| a + b).into_iter().chain(values).collect();
                terms = names;
            }
            if key == "error" && keys.tolerance.0 != 1.0 {
                out.iter_mut().for_each(|error| *error = *error * share);
            }
            Ok::<_, TaskError>(Program::reduced(&tape, &out))
        };
        let counted = |list: &[String]| {
            list.iter().enumerate().map(|(k, text)| (k.to_string(), text.clone())).collect::<Vec<_>>()
        };
        let alone = |text: &Option<String>| text.iter().map(|text| (String::new(), text.clone())).collect::<Vec<_>>();
        let summed = match &keys.reward {
            Terms::One(text) => vec![(String::new(), text.clone())],
            Terms::Sum(terms) => terms.clone().into_iter().collect(),
        };
        let usual = Some("controlled(action)".to_string());
        // Check each name of [let] alone, so that unused names are checked too.
        for name in keys.lets.keys() {
            read(Part::Reward, "let", &[(name.clone(), name.clone())], false)?;
        }
        let observe = read(Part::Other, "observation", &counted(&keys.observation), false)?;
        let act = read(Part::Act, "act", &alone(&keys.act.clone().or(usual)), false)?;
        let reward = read(Part::Reward, "reward", &summed, true)?;
        let terminated = read(Part::Other, "terminated", &alone(&keys.terminated), true)?;
        let error = read(Part::Other, "error", &alone(&keys.error), true)?;
        let joints = system.robot.joint_count();
        if act.out.len() != joints {
            return Err(wrong(format!(
                "act: it has {} torques, and `{}` has {joints} joints",
                act.out.len(),
                system.name
            )));
        }
        if reward.out.is_empty() {
            return Err(wrong("reward: it has no term".into()));
        }
        let read = [&observe, &act, &reward, &terminated, &error].map(Program::goals);
        let last = read.into_iter().max().unwrap_or(0).saturating_sub(goal.len());
        let memory = if last > 2 * actions {
            last
        } else if last > 0 {
            2 * actions
        } else {
            0
        };
        let named = commands.iter().flat_map(|(name, at)| {
            at.clone().map(move |k| if at.len() > 1 { format!("{name}[{}]", k - at.start) } else { name.clone() })
        });
        let named = named.collect();
        let about = About {
            name: kept(name),
            robot: kept(robot),
            scene: kept(&scene.name),
            observation: observe.out.len(),
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
            goal,
            names: named,
            terms,
            place,
            keys,
            observe,
            act,
            reward,
            terminated,
            error,
            memory,
            levels,
        })
    }
}

/// Ranges of the goal's numbers; the position of each command in the goal; whether the goal's first three numbers are a
/// `target` to be displayed.
type Commands = (Vec<[f64; 2]>, Vec<(String, Range<usize>)>, bool);

fn commands(keys: &Keys) -> Commands {
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

fn levels(keys: &Keys) -> Result<(), String> {
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

fn ranges(keys: &Keys) -> Result<(), String> {
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
fn names(facts: &Facts, keys: &Keys, commands: &[(String, Range<usize>)]) -> Result<(), String> {
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
        self.act.controlled()
    }

    fn tolerance(&self) -> (f64, &str) {
        (self.keys.tolerance.0, &self.keys.tolerance.1)
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out.copy_from_slice(&self.observe.replay(sight.tape, &[], &[]));
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        torques.copy_from_slice(&self.act.replay(sight.tape, action, &[]));
    }

    fn reward<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Traced<'a> {
        self.rewards(sight, torques)[0]
    }

    fn terms(&self) -> &[String] {
        &self.terms
    }

    fn rewards<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Vec<Traced<'a>> {
        self.reward.replay(sight.tape, &[], torques)
    }

    fn error<'a>(&self, sight: &Sight<'a>) -> Option<Traced<'a>> {
        self.error.replay(sight.tape, &[], &[]).first().copied()
    }

    fn terminated<'a>(&self, sight: &Sight<'a>) -> Traced<'a> {
        self.terminated.replay(sight.tape, &[], &[]).first().copied().unwrap_or(0.0.into())
    }
}
