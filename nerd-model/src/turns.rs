//! What a joint's predicted turn counts from.
//!
//! Along a chain of n links an error in one joint's angle swings all that hangs on it, so errors of targets that count from the parent link
//! add up twice on the way to the end. Counted from the root, a target says how far a *link* has turned, and one link's error moves
//! it alone.
//!
//! With `d_j` the change of coordinate j, `a_j` its axis (world, unit length; nothing for a slide) at the base, and `w_i` the turn of link i,
//!
//! ```text
//! w_i = w_parent + a_j d_j        target_j = d_j + a_j . w_parent
//! ```
//!
//! link by link from the root, where w is 0; velocities likewise. A joint that follows another turns nothing here. So it can be undone exactly.

use nalgebra::Vector3;
use nerd_core::dynamics::Data;
use nerd_core::robot::Robot;
use serde::{Deserialize, Serialize};

/// What a joint's predicted turn counts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turns {
    /// Its parent link: the change of its own coordinate (paper).
    #[default]
    Parent,
    /// The root: how far its link turns about its axis.
    Root,
}

impl Turns {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["parent", "root"];

    /// Whether it is the paper's.
    pub fn usual(&self) -> bool {
        *self == Self::Parent
    }
}

/// Turns a change `[q, qd]` of joints into how far links turn, or `back`; `data` holds the robot's kinematics at the base.
pub(crate) fn count(robot: &Robot, data: &Data, change: &mut [f64], back: bool, turns: &mut Vec<Vector3<f64>>) {
    let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
    for first in [coords, robot.nq() + dofs] {
        turns.clear();
        for (i, link) in robot.links.iter().enumerate() {
            let from = link.parent.map_or_else(Vector3::zeros, |parent| turns[parent]);
            let Some(joint) = link.joint.as_ref().filter(|joint| joint.mimic().is_none()) else {
                turns.push(from);
                continue;
            };
            debug_assert_eq!(joint.ratio(), 1.0);
            let (axis, x) = (data.axis[i].ang, &mut change[first + data.dof[i] - dofs]);
            let carried = axis.dot(&from);
            if back {
                *x -= carried;
            }
            turns.push(from + axis * *x);
            if !back {
                *x += carried;
            }
        }
    }
}
