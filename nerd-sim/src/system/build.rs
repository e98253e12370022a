//! Builds a system from its parts: checks the specification against the robot and applies it.

use std::collections::{HashMap, HashSet};

use nalgebra::UnitVector3;
use nerd_core::robot::Hull;

use super::start::{MAX_DRAWS, clear_start};
use super::validate::{RESERVED, check};
use super::{folds::Folds, model::Source};
use crate::internal::*;
use crate::robots::world::{World, soften};
use crate::robots::{derive::stiffen, spec::ContactSpec};

impl System {
    /// Builds a system from a robot and an unchecked specification.
    pub(crate) fn new(
        name: &str,
        read: impl Into<UrdfRobot>,
        world: World,
        mut spec: Spec,
        source: Source,
    ) -> Result<Self, SystemError> {
        let UrdfRobot { mut robot, notes, meshes, hulls, mut base } = read.into();
        if source != Source::Derived || spec.floating {
            base.clear();
        }
        let wrong = |text: String| SystemError::Spec(name.into(), text);
        name_columns(&robot, &mut spec);
        check(&spec, &robot).map_err(wrong)?;
        // From here on, joint specifications are in the order of the coordinates.
        let places: HashMap<&str, usize> = robot.joints().enumerate().map(|(i, j)| (j.name.as_str(), i)).collect();
        spec.joints.sort_by_key(|joint| places.get(joint.name.as_str()).copied());
        if let Some(root) = &mut spec.root {
            upright(&mut root.quaternion);
        }
        equip(&mut robot, &spec, source != Source::Derived);
        fits(&spec, &robot).map_err(wrong)?;
        let stand_in = |name: &String| robot.link(spec.mass_matrix_of.get(name).unwrap_or(name)).unwrap_or_default();
        let stand_ins =
            robot.links.iter().filter(|_| !spec.mass_matrix_of.is_empty()).map(|l| stand_in(&l.name)).collect();
        let frame_time = spec.seconds();
        let folds = Folds::default();
        let (motors, drawn, file) = Default::default();
        let World { colliders: world, surfaces } = world;
        let margin = surfaces.margin();
        let surfaces = Arc::new(surfaces);
        let one_friction = None;
        let mut system = Self {
            name: name.into(),
            robot,
            frame_time,
            spec,
            source,
            notes,
            meshes,
            base,
            world,
            surfaces,
            margin,
            one_friction,
            motors,
            file,
            drawn,
            stand_ins,
            folds,
        };
        system.touch(&hulls).map_err(wrong)?;
        system.spec.truth.check(&system.robot, !system.folds.is_empty()).map_err(|e| wrong(format!("truth: {e}")))?;
        if let Some(scene) = &system.spec.data_scene {
            system.scene(scene)?;
        }
        system.startable()?;
        Ok(system)
    }

    /// Gives surfaces their stiffness under the robot's weight, and finds the links that may touch each other.
    fn touch(&mut self, hulls: &[Hull]) -> Result<(), String> {
        let state = self.default_state();
        let gravity = self.gravity();
        let material = self.spec.material;
        soften(Arc::make_mut(&mut self.surfaces), &self.robot, &state, &gravity, &material)?;
        if self.spec.self_collision {
            let (folds, note) =
                Folds::new(&self.robot, hulls, &self.surfaces, &self.default_state()[..self.robot.nq()]);
            self.folds = folds;
            self.notes.push(note);
        }
        Ok(())
    }

    /// Refuses a system without a start clear of its scene.
    fn startable(&self) -> Result<(), SystemError> {
        for which in [Start::Sample, Start::Reset] {
            if clear_start(self, which, &mut stream(0, 0)).is_none() {
                let [starts, remedy] = self.source.starts(self.spec.root.is_some(), which.name());
                return Err(SystemError::Blocked(
                    self.name.clone(),
                    format!("{MAX_DRAWS} starts {starts}"),
                    self.spec.data_scene.clone().unwrap_or_default(),
                    remedy,
                ));
            }
        }
        Ok(())
    }
}

/// Refuses random planes and pegs for a robot without contact points, and a `[vary]` that does not fit the robot.
fn fits(spec: &Spec, robot: &Robot) -> Result<(), String> {
    let random = [("random_plane", spec.random_plane.is_some()), ("random_pegs", spec.random_pegs.is_some())];
    if let Some((key, _)) = random.into_iter().find(|(_, asked)| *asked && robot.contact_points.is_empty()) {
        return Err(format!("{key}: the robot has no contact point that could touch it; give it [[contact]] points"));
    }
    spec.vary.as_ref().map_or(Ok(()), |vary| vary.fits(robot))
}

/// Applies the parameters of a checked specification to the robot.
fn equip(robot: &mut Robot, spec: &Spec, specified: bool) {
    for (joint, own) in robot.joints_mut().zip(&spec.joints) {
        (joint.armature, joint.stiffness, joint.rest) = (own.armature, own.stiffness, own.rest);
        if let (Some(limit), Some(law)) = (&mut joint.limit, own.limit) {
            (limit.stiffness, limit.damping) = (law.stiffness, law.damping);
        }
    }
    let missing: Vec<bool> = spec.joints.iter().map(|j| j.limit.is_none()).collect();
    stiffen(robot, &missing, spec.seconds() / spec.substeps as f64);
    if !spec.contacts.is_empty() {
        let points = |c: &ContactSpec| {
            robot.link(&c.link).map(|link| c.points(link, &robot.links[link].frame)).unwrap_or_default()
        };
        let listed: Vec<ContactPoint> = spec.contacts.iter().flat_map(points).collect();
        // A listed contact point that equals a point of the robot's file gets that point's surface. Each point of the
        // file is used once, since positions may coincide.
        let mut own: Vec<_> =
            std::mem::take(&mut robot.contact_points).into_iter().filter(|p| p.surface.is_some()).collect();
        let mut surface =
            |p: &ContactPoint| own.iter().position(|own| same(own, p)).and_then(|k| own.remove(k).surface);
        robot.contact_points = listed.into_iter().map(|p| p.clone().on(surface(&p))).collect();
    } else if specified && spec.scenes.is_empty() && spec.random_plane.is_none() {
        // The robot has nothing to touch; without contact points the solver skips contact.
        robot.contact_points.clear();
    }
}

/// Whether two contact points are equal up to rounding.
fn same(a: &ContactPoint, b: &ContactPoint) -> bool {
    let near = |a: Vec<Vector3<f64>>, b: Vec<Vector3<f64>>| {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).amax() < 1e-9)
    };
    a.link == b.link && a.radius == b.radius && near(a.places(), b.places())
}

impl ContactSpec {
    /// The contact points on link `link`, with positions given in `frame`. The specification is already checked.
    fn points(&self, link: usize, frame: &Isometry3<f64>) -> Vec<ContactPoint> {
        let place = |at: [f64; 3]| frame.transform_point(&at.into()).coords;
        let vertices = || self.vertices.iter().map(|v| place(*v)).collect::<Vec<_>>();
        let mut points = match (self.point, self.axis.zip(self.rim)) {
            (None, _) => vec![ContactPoint::hull(link, vertices(), self.radius)],
            (Some(at), None) => vec![ContactPoint::new(link, place(at), self.radius)],
            (Some(at), Some((axis, rim))) => {
                let axis = frame.rotation * UnitVector3::new_normalize(Vector3::from(axis));
                ContactPoint::disc(link, place(at), axis, rim, self.radius).into()
            }
        };
        points.iter_mut().for_each(|p| p.thickness = self.thickness.unwrap_or(self.radius));
        points
    }
}

/// Normalises a quaternion; a unit quaternion up to rounding stays unchanged.
fn upright(quaternion: &mut [f64; 4]) {
    let size = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (size - 1.0).abs() > 1e-12 {
        quaternion.iter_mut().for_each(|x| *x /= size);
    }
}

/// Fills in the column names that the specification leaves out: joint names, with a prefix `q_` where a name would
/// clash with another column.
pub(crate) fn name_columns(robot: &Robot, spec: &mut Spec) {
    let root = |names: &[&str]| names.iter().filter(|_| robot.floating()).map(|n| n.to_string()).collect::<Vec<_>>();
    let (pose, twist) =
        (root(&["px", "py", "pz", "qx", "qy", "qz", "qw"]), root(&["wx", "wy", "wz", "vx_s", "vy_s", "vz_s"]));
    let given: HashMap<&str, &String> =
        spec.joints.iter().filter_map(|s| Some((s.name.as_str(), s.column.as_ref()?))).collect();
    let mut taken: HashSet<String> = pose.iter().chain(&twist).cloned().chain(RESERVED.map(String::from)).collect();
    let mut column = |joint: &Joint| {
        let clashes = |taken: &HashSet<String>, name: &str| {
            name.is_empty() || name.starts_with("tau") || taken.contains(name) || taken.contains(&format!("d_{name}"))
        };
        let name = given.get(joint.name.as_str()).map(|column| column.to_string()).unwrap_or_else(|| {
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
