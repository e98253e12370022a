//! The solvers that models learn from. A model card names solver and settings, since the same engine with other
//! settings gives another motion.

use nerd_core::robot::Robot;
use serde::{Deserialize, Serialize};

/// The solver that a model learns from and is compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Truth {
    /// `articulated`, preset `accurate`: implicit contact, with the robot's number of substeps.
    #[default]
    Articulated,
    /// `articulated`, preset `paper`, Coulomb friction: the method of the reference simulator. For robots `NAME-paper`,
    /// with the reference's materials and substeps.
    Paper,
    /// rapier's multibodies, 4 steps of 4 iterations per frame, in a floating robot's own axes.
    #[cfg(feature = "rapier")]
    Rapier,
}

/// Steps per frame of rapier as a truth: at 60 frames/s, contacts are found 240 times a second. Each step has rapier's
/// default of 4 iterations. More steps change the motion without converging. On the Ant, the motions with 8 and 4 steps
/// differ as much as those with 16 and 8. A model also learns rapier's faults, such as a fast tip sinking 29 mm into
/// the ground (`nerd-sim/tests/solvers/rapier.rs`; `results/stability`). Every frame is stepped in a new rapier world,
/// in the axes of a floating root. The next state thus depends on no warm start, other trajectory or heading.
#[cfg(feature = "rapier")]
pub(crate) const STEPS: usize = 4;
#[cfg(feature = "rapier")]
pub(crate) const ITERATIONS: usize = 4;

/// Prefix of the name of a truth that is recorded motion; the name of its log follows. No solver steps such a truth.
pub const RECORDED: &str = "recorded ";

impl Truth {
    /// All truths.
    pub const ALL: &[Self] = &[
        Self::Articulated,
        Self::Paper,
        #[cfg(feature = "rapier")]
        Self::Rapier,
    ];

    /// Name on model cards and in shards.
    pub fn name(self) -> String {
        match self {
            Self::Articulated => "articulated accurate".into(),
            Self::Paper => "articulated paper coulomb".into(),
            #[cfg(feature = "rapier")]
            Self::Rapier => format!("rapier {STEPS} steps {ITERATIONS} iterations, own axes"),
        }
    }

    /// The truth with this name.
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

    /// Refuses a robot that the solver cannot step; `folds`: whether the robot has self-collision.
    pub fn check(self, robot: &Robot, folds: bool) -> Result<(), String> {
        if self != Self::Articulated && folds {
            return Err(
                "self_collision is what `articulated` alone can step; take it, or leave self_collision out".into()
            );
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
