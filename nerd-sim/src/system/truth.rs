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
    /// rapier's multibodies, 4 steps of 4 iterations a frame, in a floating robot's own axes.
    #[cfg(feature = "rapier")]
    Rapier,
}

/// rapier as a truth: contacts found 240 times a second at 60 frames, with its usual 4 iterations, as people set it. More bring another
/// motion, not a better one: 8 steps are as far from 4 as 16 from 8 on the Ant. What it is bad at (a fast tip sinks 29 mm into the ground,
/// `nerd-sim/tests/solvers/rapier.rs`; `results/stability.md`) is learned with it. A world is made new every frame, along the axes of a
/// floating root, so that, as for every truth, the next state is a function of this one: no warm start, nothing of another trajectory, no
/// heading.
#[cfg(feature = "rapier")]
pub(crate) const STEPS: usize = 4;
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
            Self::Rapier => format!("rapier {STEPS} steps {ITERATIONS} iterations, own axes"),
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
