//! Settings of a MuJoCo simulation.

use crate::prelude::*;

/// Settings of a MuJoCo run. Contact parameters are the `[lowest, highest]` over all contacts with the world that
/// occurred. They are empty if nothing touched the world.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Settings {
    /// Time step (s).
    pub timestep: f64,
    pub integrator: String,
    pub cone: String,
    pub solver: String,
    pub impratio: f64,
    /// Gravity in world axes (m/s^2).
    pub gravity: [f64; 3],
    /// Dimensions (`condim`) of the contacts.
    pub condim: Vec<u32>,
    /// Sliding friction coefficients of the contacts.
    pub friction: Vec<[f64; 2]>,
    pub solref: Vec<[f64; 2]>,
    pub solimp: Vec<[f64; 2]>,
    /// Armature of each joint, including actuator rotors (kg m^2 or kg).
    pub armature: Vec<f64>,
    /// What the policy's actions set: torques, or targets of the file's position actuators.
    pub control: String,
    /// Whether links of the robot touched each other in the run.
    pub self_contact: bool,
    pub ground: String,
}

impl Settings {
    /// Lists the settings that differ from `other`, each with both values.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let mine = self.words();
        let theirs = other.words();
        let pairs = mine.into_iter().zip(theirs).filter(|(a, b)| a != b);
        pairs.map(|((word, a), (_, b))| format!("{word} {a} and {b}")).collect()
    }

    /// Lists the name and value of each setting.
    pub fn list(&self) -> Vec<String> {
        self.words().into_iter().map(|(word, text)| format!("{word} {text}")).collect()
    }

    fn words(&self) -> [(&'static str, String); 13] {
        let bounds = |all: &[[f64; 2]]| {
            all.iter().map(|[low, high]| [low, high].into_iter().dedup().map(|x| number(*x)).join(" to ")).join(", ")
        };
        let armature = self.armature.iter().fold([f64::INFINITY, 0.0f64], |[low, high], x| [low.min(*x), high.max(*x)]);
        let armature = if self.armature.is_empty() { Vec::new() } else { vec![armature] };
        let words = [
            ("timestep (s)", number(self.timestep)),
            ("integrator", self.integrator.clone()),
            ("cone", self.cone.clone()),
            ("solver", self.solver.clone()),
            ("impratio", number(self.impratio)),
            ("gravity", self.gravity.map(number).join(" ")),
            ("condim", self.condim.iter().join(", ")),
            ("friction", bounds(&self.friction)),
            ("solref", bounds(&self.solref)),
            ("solimp", bounds(&self.solimp)),
            ("armature", bounds(&armature)),
            ("control", self.control.clone()),
            ("self-contact", if self.self_contact { "yes" } else { "no" }.into()),
        ];
        words.map(|(word, text)| (word, if text.is_empty() { "-".into() } else { text }))
    }
}

/// Writes a number with three significant digits.
fn number(x: f64) -> String {
    format!("{x:.2e}").parse::<f64>().unwrap_or(x).to_string()
}
