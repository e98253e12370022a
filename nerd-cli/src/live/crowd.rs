//! Lines that stand for links, one for each, to draw many environments.

use nalgebra::Point3;
use nerd_core::dynamics::link_pose;
use nerd_train::replay::Solid;
use rayon::prelude::*;

use crate::prelude::*;

#[derive(Serialize)]
pub(super) struct Stick {
    hue: f64,
    /// Thickness of the line (m).
    width: f64,
    #[serde(skip)]
    link: usize,
    /// Ends of the line in link axes (m).
    #[serde(skip)]
    ends: [Point3<f64>; 2],
}

impl Stick {
    fn new(solid: &Solid) -> Option<Self> {
        let half = match solid.size[..] {
            [radius, half] => [radius, radius, if solid.kind == "cylinder" { half } else { half + radius }],
            [x, y, z] => [x, y, z],
            _ => return None,
        };
        let long = (0..3).max_by(|a, b| half[*a].total_cmp(&half[*b]))?;
        let thick = 0.5 * (half.iter().sum::<f64>() - half[long]);
        let [x, y, z, i, j, k, w] = solid.pose.map(f64::from);
        let turn = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
        let end = turn * Vector3::ith(long, half[long] - thick);
        Some(Self {
            hue: solid.hue,
            width: 2.0 * thick,
            link: solid.link?,
            ends: [-end, end].map(|end| Point3::new(x, y, z) + end),
        })
    }

    /// Makes one line for the largest shape of each link.
    pub fn all(solids: &[Solid]) -> Vec<Self> {
        let mut best = BTreeMap::<usize, Self>::new();
        for stick in solids.iter().filter_map(Self::new) {
            let size = |stick: &Self| (stick.ends[1] - stick.ends[0]).norm() + stick.width;
            if best.get(&stick.link).is_none_or(|other| size(other) < size(&stick)) {
                best.insert(stick.link, stick);
            }
        }
        best.into_values().collect()
    }
}

/// Computes the line ends of all environments but the first. They are `[env][stick][end][x, y, z]` (m) in little-endian
/// f32.
pub(super) fn ends(batch: &Batch, sticks: &[Stick]) -> Vec<u8> {
    let robot = &batch.system.robot;
    let width = batch.system.robot.state_dim();
    let own = |data: &mut Data, state: &[f64]| -> Vec<u8> {
        kinematics(robot, state, data);
        let at = |stick: &Stick| stick.ends.map(|end| link_pose(data, stick.link) * end);
        sticks.iter().flat_map(at).flat_map(|p| [p.x, p.y, p.z]).flat_map(|x| (x as f32).to_le_bytes()).collect()
    };
    batch.states[width..].par_chunks_exact(width).map_init(|| Data::new(robot), own).flatten_iter().collect()
}
