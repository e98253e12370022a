//! Names of the columns of tables.

use std::collections::{HashMap, HashSet};

use nerd_core::robot::{Joint, Robot};

use super::spec::Spec;
use super::validate::RESERVED;

/// Columns of tables that the specification leaves to us: joints by their names, with `q_` before those that would be
/// taken for another column.
pub(crate) fn name_columns(robot: &Robot, spec: &mut Spec) {
    let root = |names: &[&str]| names.iter().filter(|_| robot.floating()).map(|n| n.to_string()).collect::<Vec<_>>();
    let (pose, twist) = (root(&["px", "py", "pz", "qx", "qy", "qz", "qw"]), root(&["wx", "wy", "wz", "vx_s", "vy_s", "vz_s"]));
    let said: HashMap<&str, &String> = spec.joints.iter().filter_map(|s| Some((s.name.as_str(), s.column.as_ref()?))).collect();
    let mut taken: HashSet<String> = pose.iter().chain(&twist).cloned().chain(RESERVED.map(String::from)).collect();
    let mut column = |joint: &Joint| {
        let clashes = |taken: &HashSet<String>, name: &str| {
            name.is_empty() || name.starts_with("tau") || taken.contains(name) || taken.contains(&format!("d_{name}"))
        };
        let name = said.get(joint.name.as_str()).map(|column| column.to_string()).unwrap_or_else(|| {
            let mut name = joint.name.trim().to_string();
            while clashes(&taken, &name) {
                name = format!("q_{name}");
            }
            name
        });
        taken.extend([name.clone(), format!("d_{name}")]);
        name
    };
    let names: Vec<String> = robot.joints().map(&mut column).collect();
    if spec.state_columns.is_empty() {
        let rates = names.iter().map(|n| format!("d_{n}")).collect();
        spec.state_columns = [pose, names.clone(), twist, rates].concat();
    }
    if spec.torque_columns.is_empty() {
        spec.torque_columns = names.iter().map(|n| format!("tau_{n}")).collect();
    }
}
