//! The specification of a robot of which only links and joints are known.

use crate::internal::*;
use crate::robots::spec::{ContactSpec, JointSpec, StartSpec, mesh_points};

pub(crate) fn between(low: f64, high: f64) -> Range {
    Range { low: rounded(low.min(high)), high: rounded(high.max(low)) }
}

/// Rounds an estimate to three significant digits.
pub(crate) fn rounded(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

/// The specification of a passive robot: no torque, starts near zero.
pub(crate) fn plain(robot: &Robot) -> Spec {
    let law = |x: f64| Range { low: -x, high: x };
    let starts = |q: f64, qd: f64| StartSpec { q: law(q), qd: law(qd), minus: None };
    let joint = |joint: &Joint| JointSpec {
        name: joint.name.clone(),
        sample: starts(1.0, 1.0),
        reset: starts(0.1, 0.0),
        ..JointSpec::default()
    };
    Spec {
        floating: robot.floating(),
        frame_time: "1/60".into(),
        gravity: [0.0, 0.0, -9.81],
        substeps: 16,
        mesh_points: mesh_points(),
        joints: robot.joints().map(joint).collect(),
        ..Spec::default()
    }
}

/// The robot's contact points, as a TOML lists them.
pub(crate) fn listed(robot: &Robot) -> Vec<ContactSpec> {
    let spec = |p: &ContactPoint| {
        let frame = &robot.links[p.link].frame;
        let place = |at: &Vector3<f64>| frame.inverse_transform_point(&(*at).into()).coords.into();
        let at = || Some(place(&p.local));
        let own = match &p.locus {
            Locus::Fixed => ContactSpec { point: at(), ..ContactSpec::default() },
            // The first of a disc's three points represents all three.
            Locus::Rim { turn, .. } if *turn != 0.0 => return None,
            Locus::Rim { axis, radius, .. } => {
                let axis = frame.inverse_transform_vector(axis).into();
                ContactSpec { point: at(), axis: Some(axis), rim: Some(*radius), ..ContactSpec::default() }
            }
            Locus::Hull { vertices, .. } => {
                ContactSpec { vertices: vertices.iter().map(place).collect(), ..ContactSpec::default() }
            }
        };
        let thickness = (p.thickness != p.radius).then_some(p.thickness);
        Some(ContactSpec { link: robot.links[p.link].name.clone(), radius: p.radius, thickness, ..own })
    };
    robot.contact_points.iter().filter_map(spec).collect()
}
