//! Draws starts from the ranges of a specification.

use nalgebra::Unit;
use nerd_core::state::wrap_state;

use crate::robots::spec::{RootSpec, RootStart};
use crate::scene::GROUND;
use crate::{internal::*, random::direction};

/// The two sets of ranges of starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Starts of training data.
    Sample,
    /// Starts of evaluation and of tasks.
    Reset,
}

impl Start {
    /// Key in a specification.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Reset => "reset",
        }
    }
}

/// Maximum number of draws of a start; a specification without a clear start among them is refused.
pub(crate) const MAX_DRAWS: usize = 10_000;

/// Penetration (m) beyond which an overlap is reported.
const MAX_OVERLAP: f64 = 1e-3;

/// The first of [`MAX_DRAWS`] drawn starts with the clearance from the data's scene that the specification requires. A
/// robot on a fixed base must not start inside the scene. In static objects of its file, a robot on a fixed base may
/// start as deep as in its default pose.
pub(crate) fn clear_start(system: &System, which: Start, rng: &mut impl Rng) -> Option<Vec<f64>> {
    let Some(least) = least_clearance(system, which) else { return Some(draw(system, which, rng)) };
    let scene = system.scene(system.spec.data_scene.as_ref()?).ok()?;
    let mut data = Data::new(&system.robot);
    let mut events = Vec::new();
    (0..MAX_DRAWS).map(|_| draw(system, which, rng)).find(|state| {
        contacts(system, &scene, state, &mut data, &mut events);
        events.iter().zip(&least).all(|(e, least)| e.distance >= *least)
    })
}

/// Least distance (m) of each contact point from the data's scene at a start; `None` where there is no requirement.
pub(crate) fn least_clearance(system: &System, which: Start) -> Option<Vec<f64>> {
    let points = &system.robot.contact_points;
    match &system.spec.root {
        Some(root) => laws(root, which).clearance.map(|least| vec![least; points.len()]),
        None => {
            let name = system.spec.data_scene.as_ref().filter(|_| !system.robot.floating())?;
            let outside = points.iter().map(|p| p.radius).fold(0.0, f64::max);
            if name != GROUND || system.world.is_empty() {
                return Some(vec![outside; points.len()]);
            }
            let scene = system.scene(name).ok()?;
            let mut events = Vec::new();
            contacts(system, &scene, &system.default_state(), &mut Data::new(&system.robot), &mut events);
            Some(events.iter().map(|event| outside.min(event.distance)).collect())
        }
    }
}

/// Reports, in one line, the deepest overlap of a robot on a fixed base with its file's ground in the default pose.
pub(crate) fn overlaps(system: &System) -> Option<String> {
    let scene = system.scene(GROUND).ok().filter(|_| !system.robot.floating())?;
    let mut events = Vec::new();
    let robot = &system.robot;
    contacts(system, &scene, &system.default_state(), &mut Data::new(robot), &mut events);
    let deep = |(event, point): (&ContactEvent, &ContactPoint)| (point.radius - event.distance, point.link);
    let (depth, link) = events.iter().zip(&robot.contact_points).map(deep).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let name = &robot.links[link].name;
    (depth > MAX_OVERLAP)
        .then(|| format!("`{name}` is {:.1} mm inside of what stands in its file, and is pushed out", 1e3 * depth))
}

fn laws(root: &RootSpec, which: Start) -> &RootStart {
    match which {
        Start::Reset => root.reset.as_ref().unwrap_or(&root.sample),
        Start::Sample => &root.sample,
    }
}

pub(crate) fn draw(system: &System, which: Start, rng: &mut impl Rng) -> Vec<f64> {
    let robot = &system.robot;
    let mut state = robot.zero_state();
    let coords = robot.root_coords();
    let nq = robot.nq();
    let rates = robot.nq() + robot.root_dofs();
    if let Some(root) = &system.spec.root {
        let laws = laws(root, which);
        let mut vector = |laws: &[Range; 3]| Vector3::from(laws.each_ref().map(|l| l.draw(rng)));
        let (p, w, v) = (vector(&laws.position), vector(&laws.ang_vel), vector(&laws.velocity));
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_unchecked(direction(rng)), laws.tilt.draw(rng));
        let pose = quaternion(&root.quaternion) * turn;
        state[..3].copy_from_slice(p.as_slice());
        write_quaternion(&mut state[3..7], &pose);
        write_twist(&mut state[nq..rates], (&p, &pose), (&w, &v));
    }
    let specs = &system.spec.joints;
    let laws = |i: usize| if which == Start::Sample { &specs[i].sample } else { &specs[i].reset };
    for i in 0..specs.len() {
        state[coords + i] = laws(i).q.draw(rng);
        if let Some(other) = laws(i).minus.as_ref().and_then(|name| specs[..i].iter().position(|s| &s.name == name)) {
            state[coords + i] -= state[coords + other];
        }
    }
    for i in 0..specs.len() {
        state[rates + i] = laws(i).qd.draw(rng);
    }
    wrap_state(robot, &mut state);
    state
}

/// Writes a root's twist (rad/s, m/s) about the world's origin. `p`, `pose`: the root's position (m) and orientation;
/// `w`, `v`: its angular and linear velocity in body axes.
pub(crate) fn write_twist(
    out: &mut [f64],
    (p, pose): (&Vector3<f64>, &UnitQuaternion<f64>),
    (w, v): (&Vector3<f64>, &Vector3<f64>),
) {
    let w = pose * w;
    out[..3].copy_from_slice(w.as_slice());
    out[3..].copy_from_slice((pose * v + p.cross(&w)).as_slice());
}
