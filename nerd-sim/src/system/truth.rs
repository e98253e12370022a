//! The solvers that models learn from. A model's card names its own with settings, since the same engine at other settings is another
//! motion.

use nerd_core::robot::Robot;
use serde::{Deserialize, Serialize};

/// What a model learns and is compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Truth {
    /// `articulated`, preset `accurate`: implicit contact, as many substeps as the robot asks for.
    #[default]
    Articulated,
    /// `articulated`, preset `paper`, Coulomb friction: the reference simulator's method. Meant for robots `NAME-paper`, which
    /// have its materials and substeps.
    Paper,
    /// rapier's multibodies, 16 steps of 4 iterations a frame.
    #[cfg(feature = "rapier")]
    Rapier,
}

/// rapier as a truth. Sixteen steps, since each finds contacts again: at four, its default, the pendulum's tip sinks 29 mm
/// into the ground before it is stopped (`nerd-sim/tests/rapier.rs`) and the Ant's inner torques change its momentum beyond
/// the suite's limit (`results/stability.md`); at sixteen it is 0.03 mm, and within the limit. More bring nothing: what it
/// then still fails of the suite (friction by direction, no bounce) is its contact law, and 64 steps are as far from 16 as
/// those from 4. A world is made new every frame, so that, as for every truth, the next state is a function of
/// this one: no warm start, nothing of another trajectory.
#[cfg(feature = "rapier")]
pub(crate) const STEPS: usize = 16;
#[cfg(feature = "rapier")]
pub(crate) const ITERATIONS: usize = 4;

/// How the truth of a model begins that learned recorded motion, before the name of its log. No solver is that.
pub const RECORDED: &str = "recorded ";

impl Truth {
    /// All of them.
    pub const ALL: &[Self] = &[
        Self::Articulated,
        Self::Paper,
        #[cfg(feature = "rapier")]
        Self::Rapier,
    ];

    /// As cards and shards have it.
    pub fn name(self) -> String {
        match self {
            Self::Articulated => "articulated accurate".into(),
            Self::Paper => "articulated paper coulomb".into(),
            #[cfg(feature = "rapier")]
            Self::Rapier => format!("rapier {STEPS} steps {ITERATIONS} iterations"),
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Result<Self, String> {
        if let Some(log) = name.strip_prefix(RECORDED) {
            return Err(format!(
                "what was learned is the recorded motion `{log}`, which no solver steps: compare with it by `evaluate --data`"
            ));
        }
        let known = || Self::ALL.iter().map(|t| t.name()).collect::<Vec<_>>().join(", ");
        let found = Self::ALL.iter().find(|t| t.name() == name).copied();
        found.ok_or_else(|| format!("no truth is called `{name}`; choose from {}", known()))
    }

    /// Refuses a robot that it cannot step as it says; `folds` tells whether its links touch each other.
    pub fn check(self, robot: &Robot, folds: bool) -> Result<(), String> {
        if self != Self::Articulated && folds {
            return Err("self_collision is what `articulated` alone can step; take it, or leave self_collision out".into());
        }
        match robot.joints().find(|j| self == Self::Paper && j.stiffness > 0.0) {
            Some(joint) => Err(format!(
                "joint `{}` has a spring (stiffness), which `paper` cannot step: its method is explicit; take articulated",
                joint.name
            )),
            None => Ok(()),
        }
    }
}
