//! Keys of a task's file.

use std::collections::BTreeMap;

use nerd_sim::prelude::*;
use nerd_sim::{scene::TerrainSpec, system::SystemError};
use serde::{Deserialize, Deserializer, de::Error};
use toml::{Table, Value};

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Keys {
    /// Default robot, used if none is named with the task.
    pub robot: Option<String>,
    /// Scene [default: the scene of the robot's data, else `free`].
    pub scene: Option<String>,
    /// Uneven terrain in place of a scene.
    pub terrain: Option<TerrainSpec>,
    /// Number of levels in training. A level is a factor on the terrain's heights.
    pub levels: Option<usize>,
    /// Frame time (s) [default: the robot's].
    #[serde(default, deserialize_with = "seconds")]
    pub frame_time: Option<f64>,
    /// Substeps per frame [default: the robot's].
    pub substeps: Option<usize>,
    /// Whether joints without armature get a rotor's inertia.
    #[serde(default)]
    pub rotors: bool,
    /// Frames per step.
    #[serde(default = "one")]
    pub frames: u64,
    /// Steps per episode.
    pub steps: u64,
    /// Width of an action [default: one number per joint].
    pub actions: Option<usize>,
    /// Commands, drawn for each episode.
    #[serde(default)]
    pub command: BTreeMap<String, Command>,
    /// Named expressions.
    #[serde(default, rename = "let", deserialize_with = "lets")]
    pub lets: BTreeMap<String, String>,
    pub observation: Vec<String>,
    /// Torques [default: the robot's controller].
    pub act: Option<String>,
    pub reward: Terms,
    pub terminated: Option<String>,
    pub error: Option<String>,
    /// Tolerance of the error and its unit [default: 1].
    #[serde(default)]
    pub tolerance: Tolerance,
}

impl Keys {
    /// The robot with the file's frame time, substeps, rotors and terrain.
    pub fn fit(&self, mut robot: Arc<System>) -> Result<Arc<System>, SystemError> {
        let own = Arc::make_mut(&mut robot);
        if self.frame_time.is_some() || self.substeps.is_some() {
            *own = own.paced(self.frame_time, self.substeps)?;
        }
        if self.rotors {
            *own = own.clone().with_rotors();
        }
        if let Some(terrain) = self.terrain {
            *own = own.clone().with_terrain(terrain)?;
        }
        Ok(robot)
    }
}

/// A number with its unit, such as "0.1 m/s", or a number alone.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(super) struct Tolerance(pub f64, pub String);

impl Default for Tolerance {
    fn default() -> Self {
        Self(1.0, String::new())
    }
}

impl TryFrom<Value> for Tolerance {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let text = expression("tolerance", value)?;
        let (number, unit) = text.split_once(' ').unwrap_or((&text, ""));
        let number = number.parse::<f64>().ok().filter(|x| (1e-9..=1e6).contains(x));
        let number = number.ok_or_else(|| {
            format!("tolerance is \"{text}\": a number from 1e-9 to 1e6 is needed and its unit, such as \"0.1 m/s\"")
        })?;
        // Units are not converted, so only SI units are accepted.
        if let Some(other) =
            unit.split(|c: char| !c.is_alphabetic() && c != '%').find(|u| !["", "m", "rad", "s", "kg", "N"].contains(u))
        {
            let known = [
                ("cm", 1e-2, "m"),
                ("mm", 1e-3, "m"),
                ("ms", 1e-3, "s"),
                ("g", 1e-3, "kg"),
                ("deg", 1f64.to_radians(), "rad"),
            ];
            let known = known.iter().find(|(own, ..)| *own == other);
            let (number, unit) =
                known.map_or((0.1, "m/s".into()), |(_, factor, si)| (number * factor, unit.replacen(other, si, 1)));
            let number = (number * 1e6).round() / 1e6;
            return Err(format!(
                "tolerance is \"{text}\": `{other}` is no SI unit (m, rad, s, kg, N); write \"{number} {unit}\""
            ));
        }
        Ok(Self(number, unit.trim().into()))
    }
}

fn one() -> u64 {
    1
}

fn seconds<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    f64::deserialize(from)
        .map(Some)
        .map_err(|_| D::Error::custom("frame_time: a number of seconds is needed, without quotes"))
}

/// Text of an expression. A number is converted to text.
fn expression(key: &str, value: Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(text),
        Value::Integer(x) => Ok(x.to_string()),
        Value::Float(x) => Ok(x.to_string()),
        other => Err(format!("{key} is {}: an expression in quotes is needed, or a number", other.type_str())),
    }
}

fn expressions(key: &str, all: Table) -> Result<BTreeMap<String, String>, String> {
    all.into_iter().map(|(name, value)| Ok((name.clone(), expression(&format!("{key}.{name}"), value)?))).collect()
}

fn lets<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<String, String>, D::Error> {
    expressions("let", Table::deserialize(from)?).map_err(D::Error::custom)
}

/// Ranges of one command: one range for a scalar, one for each number of a vector.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(super) struct Command(pub Vec<Range>);

impl TryFrom<Value> for Command {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let all = if let Value::Array(all) = value { all } else { vec![value] };
        let range = |value| match value {
            Value::String(text) => Range::try_from(text),
            _ => Err("a range \"U(low, high)\" is needed, or a list of them".into()),
        };
        all.into_iter().map(range).collect::<Result<_, _>>().map(Self)
    }
}

/// A reward: one expression, or a sum of named ones.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Value")]
pub(super) enum Terms {
    One(String),
    Sum(BTreeMap<String, String>),
}

impl TryFrom<Value> for Terms {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match value {
            Value::Table(all) => expressions("reward", all).map(Self::Sum),
            one => expression("reward", one).map(Self::One),
        }
    }
}
