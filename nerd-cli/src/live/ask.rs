//! Requests that the live page sends.

use serde::Deserialize;

use nerd_sim::range::within;

use super::menu::MOST;

/// One request, as JSON: `{"do": "gravity", "to": 3.7}`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", content = "to", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// Pauses (true) or resumes the motion.
    Pause(bool),
    /// Steps one frame, or one policy step.
    Step,
    /// Resets all environments; a policy begins its next episodes.
    Reset,
    /// Swaps the solver and keeps the present state: index in the page's list of solvers.
    Solver(usize),
    /// Sets the substeps per frame, from 1 to 64, of a solver with this setting.
    Substeps(usize),
    /// Selects a robot: index in the page's list of robots.
    Robot(usize),
    /// Selects a scene of the robot: index in the page's list of scenes.
    Scene(usize),
    /// Selects a policy and its task: number in the page's list of policies, from 1; 0 for none.
    Policy(usize),
    /// Sets the number of environments: from 1 to [`super::MOST`].
    Envs(usize),
    /// Whether a ghost shows the truth's motion, from the present state on.
    Ghost(bool),
    /// Whether the joints of a robot without a policy hold the default pose, or are limp.
    Hold(bool),
    /// Sets all friction coefficients: from 0 to 4.
    Friction(f64),
    /// Sets gravity along the scene's direction: from 0 to 30 m/s^2.
    Gravity(f64),
    /// Pulls a link by a spring until [`Ask::Release`]: link index, point of the link (m, link axes), target (m, world
    /// axes).
    Drag(usize, [f64; 3], [f64; 3]),
    /// Removes the spring of [`Ask::Drag`].
    Release,
}

/// Largest absolute coordinate of the points of a [`Ask::Drag`] (m).
const FAR: f64 = 1e3;

impl Ask {
    pub fn read(text: &str) -> Result<Self, String> {
        let ask: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        match &ask {
            Self::Friction(to) => within("friction", *to, 0.0..=4.0, "")?,
            Self::Substeps(to) => within("substeps", *to as f64, 1.0..=64.0, "")?,
            Self::Envs(to) => within("envs", *to as f64, 1.0..=MOST as f64, "")?,
            Self::Gravity(to) => within("gravity", *to, 0.0..=30.0, "m/s^2")?,
            Self::Drag(_, local, target) => {
                local.iter().chain(target).try_for_each(|x| within("drag", *x, -FAR..=FAR, "m"))?
            }
            _ => (),
        }
        Ok(ask)
    }
}
