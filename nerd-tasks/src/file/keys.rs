//! The keys of a task's file.

use std::collections::BTreeMap;

use nerd_sim::prelude::*;
use nerd_sim::{scene::TerrainSpec, system::SystemError};
use serde::Deserialize;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Keys {
    /// Robot, where none is named with the task.
    pub robot: Option<String>,
    /// Scene [default: that of the robot's data, else `free`].
    pub scene: Option<String>,
    /// Ground that is not flat, in place of a scene.
    pub terrain: Option<TerrainSpec>,
    /// Levels of difficulty in training: shares of the terrain's heights.
    pub levels: Option<usize>,
    /// One frame (s) [default: the robot's].
    pub frame_time: Option<f64>,
    /// Substeps of a frame [default: the robot's].
    pub substeps: Option<usize>,
    /// Whether joints without armature have a rotor.
    #[serde(default)]
    pub rotors: bool,
    /// Frames of a step.
    #[serde(default = "one")]
    pub frames: u64,
    /// Steps of an episode.
    pub steps: u64,
    /// Numbers in an action [default: one a joint].
    pub actions: Option<usize>,
    /// What is drawn for an episode.
    #[serde(default)]
    pub command: BTreeMap<String, Command>,
    /// Expressions by name.
    #[serde(default, rename = "let")]
    pub lets: BTreeMap<String, String>,
    pub observation: Vec<String>,
    /// Torques [default: the robot's own controller].
    pub act: Option<String>,
    pub reward: Terms,
    pub over: Option<String>,
    pub miss: Option<String>,
    /// What may be missed, and its unit [default: 1].
    #[serde(default)]
    pub allowed: Allowed,
}

impl Keys {
    /// A robot with frames, rotors and terrain as the file says.
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

/// A number and its unit, as in "0.1 m/s".
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "String")]
pub(super) struct Allowed(pub f64, pub String);

impl Default for Allowed {
    fn default() -> Self {
        Self(1.0, String::new())
    }
}

impl TryFrom<String> for Allowed {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let (number, unit) = text.split_once(' ').unwrap_or((&text, ""));
        let number = number.parse::<f64>().ok().filter(|x| *x > 0.0 && x.is_finite());
        let number =
            number.ok_or_else(|| format!("allowed is \"{text}\": a number above 0 is needed and its unit, such as \"0.1 m/s\""))?;
        // Nothing is converted, so there is one unit of each kind.
        if let Some(other) = unit.split(|c: char| !c.is_alphabetic() && c != '%').find(|u| !["", "m", "rad", "s", "kg", "N"].contains(u)) {
            return Err(format!("allowed is \"{text}\": `{other}` is no SI unit (m, rad, s, kg, N); write \"0.1 m/s\" for 10 cm/s"));
        }
        Ok(Self(number, unit.trim().into()))
    }
}

fn one() -> u64 {
    1
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a range \"U(low, high)\" is needed, or a list of them")]
pub(super) enum Command {
    One(Range),
    Some(Vec<Range>),
}

impl Command {
    pub fn ranges(&self) -> &[Range] {
        match self {
            Self::One(range) => std::slice::from_ref(range),
            Self::Some(ranges) => ranges,
        }
    }
}

/// One expression, or named ones whose sum it is.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "an expression is needed, or named ones, of which the sum is taken")]
pub(super) enum Terms {
    One(String),
    Sum(BTreeMap<String, String>),
}
