//! Requests of the page.

use serde::Deserialize;

use nerd_sim::range::within;

use super::menu::MOST;

/// One request, as JSON: `{"do": "gravity", "to": 3.7}`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", content = "to", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// Pauses or resumes.
    Pause(bool),
    /// Steps one frame.
    Step,
    /// Restarts; a policy begins its next episode.
    Reset,
    /// Swaps the solver, from the present state: index in the list.
    Solver(usize),
    /// Substeps of a frame, for solvers with a choice: from 1 to 64.
    Substeps(usize),
    /// Selects a robot: index in the list.
    Robot(usize),
    /// Selects a scene of the robot: index in the list.
    Scene(usize),
    /// Selects a policy in its task: number in the list, from 1; 0 for none.
    Policy(usize),
    /// Number of environments side by side: from 1 to [`super::MOST`].
    Envs(usize),
    /// Whether the truth runs along, from the present state.
    Ghost(bool),
    /// Whether joints without a policy hold the default pose, or are limp.
    Hold(bool),
    /// Friction coefficient: from 0 to 4.
    Friction(f64),
    /// Gravity along the scene's direction: from 0 to 30 m/s^2.
    Gravity(f64),
    /// Pulls a link (by index) with a spring from a point (m, link axes) to a target (m, world) until [`Ask::Release`].
    Drag(usize, [f64; 3], [f64; 3]),
    /// Removes the spring.
    Release,
}

/// Farthest coordinate of a drag (m).
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
