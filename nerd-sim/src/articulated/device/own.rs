//! Parameters that differ between the robots of a family ([`crate::vary`]). These parameters follow the scene in its
//! record; all other parameters are constants in the text.
//!
//! Every table of [`TABLES`] is a macro in the text: `MASS(t)` is the constant table or, where `[vary]` changes it, a
//! pointer to the robot's numbers.

use super::super::stiff::Bounds;
use super::text::Text;
use crate::prelude::*;
use crate::robots::vary::VarySpec;

type Changes = fn(&VarySpec) -> bool;

/// Name of each table, and whether `[vary]` changes it. The solver reads the tables at indices below [`SOLVERS`] from
/// its tree. The code around the solver reads the others from the record.
const TABLES: [(&str, Changes); 20] = [
    ("MASS", |v| v.mass.is_some()),
    ("COM", |v| v.com.is_some()),
    ("BODY", |v| v.mass.is_some() || v.inertia.is_some()),
    ("LIFT", |v| v.mass.is_some() || v.com.is_some()),
    ("ARMATURE", |v| v.armature.is_some()),
    ("DAMPING", damping),
    ("DRY", |v| v.joint_damping.is_some() || v.dry_friction.is_some()),
    ("LEAST", |v| bodies(v) || v.armature.is_some()),
    ("DAMPED", |v| bodies(v) || v.armature.is_some() || damping(v)),
    ("FOLD_INV_MASS", bodies),
    ("FOLD_MATERIAL", |v| v.friction.is_some() || v.stiffness.is_some() || v.contact_damping.is_some()),
    ("KP", |v| v.gain.is_some()),
    ("KD", |v| v.gain.is_some()),
    ("LATE", |v| v.delay.is_some()),
    ("STRENGTH", |v| v.strength.is_some()),
    ("ZERO", |v| v.zero.is_some()),
    ("LINE", |v| v.top_speed.is_some()),
    ("RIPPLE", |v| v.ripple.is_some()),
    ("NOISE", VarySpec::noisy),
    ("LAG", |v| v.lag.is_some()),
];
const SOLVERS: usize = 11;
/// Indices of tables: actuators and joint zeros; then noise and delay of observations.
const MOTORS: [usize; 5] = [13, 14, 15, 16, 17];
const NOISE: usize = 18;
const LAG: usize = 19;
/// Bit of [`Own`] that marks a family, set even if no table differs.
const FAMILY: u32 = 1 << 31;

fn bodies(vary: &VarySpec) -> bool {
    [vary.mass, vary.inertia, vary.com].iter().any(Option::is_some)
}

fn damping(vary: &VarySpec) -> bool {
    vary.joint_damping.is_some() || vary.damping.is_some()
}

/// Tables that differ between the robots of a batch, as bits; 0 without a family.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Own(u32);

impl Own {
    /// Tables that `[vary]` changes in a batch.
    pub(super) fn of(batch: &Batch) -> Self {
        let (Some(vary), false) = (&batch.system.spec.vary, batch.systems.is_empty()) else { return Self::default() };
        Self(TABLES.iter().enumerate().fold(FAMILY, |bits, (k, (_, changes))| bits | u32::from(changes(vary)) << k))
    }

    fn has(self, k: usize) -> bool {
        self.0 >> k & 1 == 1
    }

    /// Whether actuators or joint zeros differ.
    pub(super) fn rigged(self) -> bool {
        MOTORS.iter().any(|k| self.has(*k))
    }

    /// Whether observations have noise, and whether they are delayed.
    pub(super) fn sensed(self) -> [bool; 2] {
        [NOISE, LAG].map(|k| self.has(k))
    }

    /// Whether centres of mass differ.
    pub(super) fn centred(self) -> bool {
        self.has(1)
    }

    /// Whether dry friction differs.
    pub(super) fn dry(self) -> bool {
        self.has(6)
    }

    /// Writes the tables of a robot, as constants or as pointers to its numbers: with `solver` the solver's (in
    /// `real`), otherwise the rest (in `double`).
    pub(super) fn write(self, text: &mut Text, system: &System, solver: bool) {
        let mut at = 0;
        for (k, ((name, _), numbers)) in TABLES.iter().zip(tables(system)).enumerate() {
            let here = solver == (k < SOLVERS);
            let count = numbers.len();
            if self.has(k) {
                let place = if k < SOLVERS { format!("((of).own + {at})") } else { format!("((of) + SHARED + {at})") };
                text.0 += &if here { format!("#define {name}(of) {place}\n") } else { String::new() };
                at += count;
            } else if here {
                text.table(if solver { "real" } else { "double" }, name, numbers);
                text.0 += &format!("#define {name}(of) {name}\n");
            }
            if solver && k + 1 == SOLVERS {
                text.define([("OWNED", at)]);
            }
        }
        if solver {
            text.define([("OWN", at)]);
        }
    }

    /// Numbers that follow the scene in the record of one robot of a family.
    pub(super) fn numbers(self, robot: &System) -> Result<Vec<f64>, String> {
        if self == Self::default() {
            return Ok(Vec::new());
        }
        if robot.held() != self.held(robot) {
            return Err("a robot has no dry friction where others have some: on a device all have; raise vary.dry_friction above 0".into());
        }
        Ok(tables(robot)
            .into_iter()
            .enumerate()
            .filter(|(k, _)| self.has(*k))
            .flat_map(|(_, numbers)| numbers)
            .collect())
    }

    /// Whether the robots have dry friction, springs or links that may touch each other.
    pub(super) fn held(self, system: &System) -> bool {
        let dry = self.dry()
            && system.spec.vary.as_ref().is_some_and(|vary| vary.dry_friction.is_some_and(|range| range.high > 0.0));
        system.held() || dry
    }
}

/// Whether some link has gravity-compensated mass.
pub(super) fn lifts(robot: &Robot) -> bool {
    robot.links.iter().any(|link| link.lifted.mass != 0.0)
}

/// Numbers of a material for contact between links.
fn fold(m: &Material) -> [f64; 6] {
    [m.stiffness, m.damping, m.friction_damping, m.friction, m.margin, m.release]
}

fn tables(system: &System) -> [Vec<f64>; TABLES.len()] {
    let robot = &system.robot;
    let bounds = Bounds::new(system);
    let motors = &system.motors;
    let links = |of: &dyn Fn(&Link) -> Vec<f64>| robot.links.iter().flat_map(of).collect::<Vec<f64>>();
    let joints = |of: fn(&Joint) -> f64| robot.joints().map(of).collect::<Vec<f64>>();
    let each =
        |own: &[f64], default: f64| if own.is_empty() { vec![default; robot.joint_count()] } else { own.to_vec() };
    [
        links(&|l| vec![l.inertia.mass]),
        links(&|l| l.inertia.com.as_slice().to_vec()),
        links(&|l| l.inertia.inertia.transpose().as_slice().to_vec()),
        if lifts(robot) { links(&|l| [&[l.lifted.mass], l.lifted.at.as_slice()].concat()) } else { Vec::new() },
        links(&|l| vec![l.joint.as_ref().map_or(0.0, |j| j.ratio().powi(2) * j.armature)]),
        joints(|j| j.damping),
        joints(|j| j.friction),
        bounds.least,
        vec![bounds.damped],
        bounds.folds,
        (0..system.folds.pairs.len()).flat_map(|k| fold(&system.folding(k))).collect(),
        system.joint_specs().map(|j| j.kp).collect(),
        system.joint_specs().map(|j| j.kd).collect(),
        vec![motors.delay],
        each(&motors.strength, 1.0),
        each(&motors.zeros, 0.0),
        if motors.lines.is_empty() {
            [0.0, 1.0].repeat(robot.joint_count())
        } else {
            motors.lines.as_flattened().to_vec()
        },
        each(&motors.ripple, 0.0),
        vec![motors.noise, motors.root_noise[0], motors.root_noise[1]],
        vec![motors.lag],
    ]
}
