//! The columns of a data set: names and statistics.

use nerd_model::{base::Base, features::Features};
use nerd_sim::prelude::*;
use serde::Serialize;

/// Numbers of a token or of a target that are of one kind: a column, or of contact points all columns of their normals, places or
/// depths.
#[derive(Clone, Debug, Serialize)]
pub struct Kind {
    pub name: String,
    pub columns: usize,
    /// Numbers that are there: of contact points only those that the mask lets through.
    pub count: u64,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    square: f64,
}

/// Where a column's numbers belong: its kind, and the contact point whose mask decides whether they are there.
pub(super) type Place = (usize, Option<usize>);

impl Kind {
    fn new(name: String) -> Self {
        Self { name, columns: 0, count: 0, min: f64::MAX, max: f64::MIN, mean: 0.0, square: 0.0 }
    }

    pub(super) fn add(&mut self, x: f64) {
        self.count += 1;
        (self.min, self.max) = (self.min.min(x), self.max.max(x));
        // Welford's update: stable at millions of rows.
        let gap = x - self.mean;
        self.mean += gap / self.count as f64;
        self.square += gap * (x - self.mean);
    }

    pub fn std(&self) -> f64 {
        (self.square / self.count.max(1) as f64).sqrt()
    }

    pub fn constant(&self) -> bool {
        self.max - self.min <= 1e-6 * self.max.abs().max(1.0)
    }
}

/// The kinds of a token's columns, then of a target's, in [`Features`]' order; and the place of every column.
pub(super) fn columns(system: &System) -> (Vec<Kind>, Vec<Place>) {
    let (spec, robot) = (&system.spec, &system.robot);
    let (mut kinds, mut places): (Vec<Kind>, Vec<Place>) = (Vec::new(), Vec::new());
    let mut push = |name: String, contact: Option<usize>| {
        let kind = kinds.iter().position(|kind| kind.name == name).unwrap_or_else(|| {
            kinds.push(Kind::new(name));
            kinds.len() - 1
        });
        kinds[kind].columns += 1;
        places.push((kind, contact));
    };
    spec.state_columns.iter().for_each(|name| push(name.clone(), None));
    let situated = Features::inputs(system, Base::State) > robot.state_dim() + robot.joint_count();
    let points = if situated { robot.contact_points.len() } else { 0 };
    for (name, axes) in [("contact normals", 3), ("contact points", 3), ("contact depths", 1)] {
        (0..points).for_each(|point| (0..axes).for_each(|_| push(name.into(), Some(point))));
    }
    spec.torque_columns.iter().for_each(|name| push(name.clone(), None));
    if situated {
        ["x", "y", "z"].into_iter().for_each(|axis| push(format!("down {axis}"), None));
    }
    spec.state_columns.iter().for_each(|name| push(format!("\u{394} {name}"), None));
    (kinds, places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_robot_has_a_place_for_every_input_and_target() {
        for robot in System::built_in() {
            let system = System::named(robot).expect("built in");
            let (kinds, places) = columns(&system);
            assert_eq!(places.len(), Features::inputs(&system, Base::State) + Features::outputs(&system), "{robot}");
            assert_eq!(kinds.iter().map(|kind| kind.columns).sum::<usize>(), places.len(), "{robot}");
        }
    }
}
