//! What a visitor may ask for.

use serde::Deserialize;

use nerd_sim::range::within;

use super::menu::MOST;

/// One request, as JSON: `{"do": "gravity", "to": 3.7}`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", content = "to", rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// Stop, or go on.
    Pause(bool),
    /// One frame.
    Step,
    /// Back to the start; of a policy, the next episode.
    Reset,
    /// Another solver, from the present state: its place in the list.
    Solver(usize),
    /// Substeps of a frame, of a solver that has them: from 1 to 64.
    Substeps(usize),
    /// Another robot: its place in the list.
    Robot(usize),
    /// Another scene of the robot: its place in the list.
    Scene(usize),
    /// A policy in its task: its place in the list, from 1; 0: none.
    Policy(usize),
    /// So many environments side by side: from 1 to [`super::MOST`].
    Envs(usize),
    /// Whether the truth moves along, from the present state.
    Ghost(bool),
    /// Whether joints without a policy hold the rest pose, or hang.
    Hold(bool),
    /// Friction coefficient: from 0 to 4.
    Friction(f64),
    /// Gravity along the scene's own direction: from 0 to 30 m/s^2.
    Gravity(f64),
    /// A spring from a link, by its number, at a point (m, its axes) to a place in the world (m), until [`Ask::Release`].
    Drag(usize, [f64; 3], [f64; 3]),
    /// No spring.
    Release,
}

/// Farthest place that a link is dragged to (m).
const FAR: f64 = 1e3;

impl Ask {
    pub fn read(text: &str) -> Result<Self, String> {
        let ask: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        match &ask {
            Self::Friction(to) => within("friction", *to, 0.0..=4.0, "")?,
            Self::Substeps(to) => within("substeps", *to as f64, 1.0..=64.0, "")?,
            Self::Envs(to) => within("envs", *to as f64, 1.0..=MOST as f64, "")?,
            Self::Gravity(to) => within("gravity", *to, 0.0..=30.0, "m/s^2")?,
            Self::Drag(_, local, target) => local.iter().chain(target).try_for_each(|x| within("drag", *x, -FAR..=FAR, "m"))?,
            _ => (),
        }
        Ok(ask)
    }
}
