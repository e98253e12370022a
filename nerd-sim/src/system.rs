//! A system: a robot model together with its specification, built in or from files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::contact::ContactPoint;
use nerd_core::robot::{Link, Robot, UrdfError};
use toml::Table;

use crate::cable::{CABLES, FOREIGN};
use crate::columns::name_columns;
use crate::derive::{derived, floats, plain};
use crate::limits::stiffen;
use crate::sampling::{DRAWS, Start, clear_start, stream};
use crate::scene::Scene;
use crate::source::Source;
use crate::spec::{ContactSpec, JointSpec, Spec, mesh_points};
use crate::validate::check;
use crate::worlds::{WORLDS, described, world};

/// Name, specification and URDF of a robot that comes with the crate.
macro_rules! built_in {
    ($($name:literal, $urdf:literal;)*) => {
        [$(($name, include_str!(concat!("../assets/", $name, ".toml")), include_str!(concat!("../assets/", $urdf, ".urdf")))),*]
    };
}

const BUILT_IN: [(&str, &str, &str); 12] = built_in! {
    "cartpole", "cartpole";
    "pendulum", "pendulum";
    "cube", "cube";
    "franka", "franka";
    "ant", "ant";
    "anymal", "anymal";
    "cartpole-paper", "cartpole";
    "pendulum-paper", "pendulum";
    "cube-paper", "cube";
    "franka-paper", "franka";
    "ant-paper", "ant";
    "anymal-paper", "anymal-paper";
};

/// Why a system could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// No such built-in robot, and no such file.
    #[error("no robot `{0}`: known are {known}, or the path of a .urdf (with a .toml beside it for what URDF cannot say) or of a cable's .toml", known = [System::built_in(), System::cables()].concat().join(", "))]
    Unknown(String),
    /// No such scene.
    #[error("robot `{robot}` has no scene `{scene}`: known are {known}")]
    Scene {
        /// The robot.
        robot: String,
        /// The scene asked for.
        scene: String,
        /// What there is.
        known: String,
    },
    /// A file that could not be read.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The URDF cannot be honoured.
    #[error("robot `{0}`: {1}")]
    Urdf(String, UrdfError),
    /// The specification is wrong.
    #[error("specification of robot `{0}`: {1}")]
    Spec(String, String),
}

/// A robot, how it is driven, sampled and watched.
#[derive(Clone, Debug)]
pub struct System {
    /// Name, as on the command line.
    pub name: String,
    /// The model, with armature, limits and contact points of the specification.
    pub robot: Robot,
    /// The specification.
    pub spec: Spec,
    /// One control frame (s).
    pub frame_time: f64,
    /// Who says so.
    pub source: Source,
}

impl System {
    /// Names of the robots that come with the crate; of cables, see [`System::cables`].
    pub fn built_in() -> Vec<&'static str> {
        BUILT_IN.iter().map(|b| b.0).collect()
    }

    /// Specification (TOML) and URDF of a built-in robot, for robots that are made of it.
    pub fn texts(name: &str) -> Option<(&'static str, &'static str)> {
        BUILT_IN.iter().find(|b| b.0 == name).map(|b| (b.1, b.2))
    }

    /// A built-in robot or cable by name, or by path the robot of a URDF file or the cable of a TOML ([`crate::cable`]).
    pub fn named(name: &str) -> Result<Arc<Self>, SystemError> {
        if let Some((_, spec, urdf)) = BUILT_IN.iter().find(|b| b.0 == name) {
            return Self::from_text(name, urdf, Some(spec)).map(Arc::new);
        }
        if let Some((_, text)) = CABLES.iter().find(|c| c.0 == name) {
            return Self::from_toml(name, text).map(Arc::new);
        }
        let path = Path::new(name);
        let ending = path.extension().map(|e| e.to_string_lossy().into_owned());
        let read = |path: &Path| crate::files::read_text(path).map_err(|source| SystemError::File { path: path.into(), source });
        if ending.as_deref() == Some("toml") {
            let stem = path.file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy());
            return Self::from_toml(&stem, &read(path)?).map(Arc::new);
        }
        if ending.as_deref() != Some("urdf") {
            return Err(SystemError::Unknown(name.into()));
        }
        let beside = path.with_extension("toml");
        let spec = beside.exists().then(|| read(&beside)).transpose()?;
        let stem = path.file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy());
        let system = Self::read(&stem, &read(path)?, spec.as_deref(), Some(path))?;
        // A file that says it is of another one would be believed.
        match &system.spec.urdf {
            Some(urdf) if path.file_name().is_none_or(|file| file != urdf.as_str()) => {
                let text = format!("urdf = {urdf:?}, but {name} is what is read; write its name, or leave the line out");
                Err(SystemError::Spec(stem.into(), text))
            }
            _ => Ok(Arc::new(system)),
        }
    }

    /// From the text of a URDF and of a specification; without one, see [`System::bare`], with a fixed base. Here no file is
    /// known, and `urdf` in the specification means nothing.
    pub fn from_text(name: &str, urdf: &str, spec: Option<&str>) -> Result<Self, SystemError> {
        Self::read(name, urdf, spec, None)
    }

    /// `path` is the URDF's, from which its meshes are found.
    fn read(name: &str, urdf: &str, spec: Option<&str>, path: Option<&Path>) -> Result<Self, SystemError> {
        let wrong = |e: String| SystemError::Spec(name.into(), e.trim().replace('\n', " "));
        let text = match (spec, path) {
            (Some(text), _) => text,
            (None, Some(_)) => return Self::derived(name, urdf, path, Table::new()),
            (None, None) => return Self::bare_at(name, urdf, false, path),
        };
        if let Some(own) = Spec::like_urdf(text).map_err(wrong)? {
            return Self::derived(name, urdf, path, own);
        }
        let spec = Spec::read(text).map_err(wrong)?;
        let mut robot = Robot::from_urdf(urdf, spec.floating).map_err(|e| SystemError::Urdf(name.into(), e))?;
        touch(&mut robot, path, spec.mesh_points);
        Self::new(name, robot, spec, Source::Told)
    }

    /// From a URDF, with what its numbers suggest (`derive.rs`) where `own`, keys of a specification, is silent.
    fn derived(name: &str, urdf: &str, path: Option<&Path>, own: Table) -> Result<Self, SystemError> {
        let points = own.get("mesh_points").and_then(toml::Value::as_integer).map_or(mesh_points(), |n| n.max(0) as usize);
        let read = |floating| {
            let mut robot = Robot::from_urdf_alone(urdf, floating)?;
            touch(&mut robot, path, points);
            Ok(robot)
        };
        let urdf_error = |e| SystemError::Urdf(name.into(), e);
        let (floating, cannot) = match (own.get("floating").and_then(toml::Value::as_bool), read(true)) {
            (Some(said), _) => (said, None),
            // Where a fixed base cannot be had, a free one is what the file asks for.
            (None, Ok(robot)) => (floats(&robot) || read(false).is_err(), None),
            (None, Err(e)) => (false, Some(e)),
        };
        // Where neither base can be had, what stands against the free one is what is wrong.
        let mut robot = match (read(floating), cannot) {
            (Err(UrdfError::Still), Some(e)) => return Err(urdf_error(e)),
            (read, Some(e)) => {
                let mut robot = read.map_err(urdf_error)?;
                robot.notes.push(format!("its base is taken as fixed, since a free one cannot be: {e}"));
                robot
            }
            (read, None) => read.map_err(urdf_error)?,
        };
        if own.get("contact").and_then(toml::Value::as_array).is_some_and(Vec::is_empty) {
            robot.contact_points.clear();
        }
        let joints = own.get("joint").and_then(toml::Value::as_array).into_iter().flatten();
        let said = |joint: &toml::Value| Some((joint.get("name")?.as_str()?.to_string(), joint.get("default")?.as_float()?));
        let defaults = joints.filter_map(said).collect();
        let spec =
            derived(&mut robot, path, &defaults).over(own).map_err(|e| SystemError::Spec(name.into(), e.trim().replace('\n', " ")))?;
        Self::new(name, robot, spec, Source::Derived)
    }

    /// Its specification as TOML: with `urdf = ...` it may stand beside the file, and be changed.
    pub fn spec_text(&self) -> String {
        if self.source != Source::Cable {
            return toml::to_string(&self.spec).unwrap_or_default();
        }
        // Beside `[cable]` stand only the keys that mean something of one.
        let mut keys = Table::try_from(&self.spec).unwrap_or_default();
        keys.retain(|key, _| FOREIGN.iter().all(|(foreign, _)| *foreign != key));
        toml::to_string(&keys).unwrap_or_default()
    }

    /// From a robot that was built in code, and the text of a specification; without one as [`System::bare`]. Joints of the robot are known
    /// to the specification by their names.
    pub fn from_robot(robot: Robot, spec: Option<&str>) -> Result<Self, SystemError> {
        let name = robot.name.clone();
        let Some(text) = spec else {
            let spec = plain(&robot);
            return Self::new(&name, robot, spec, Source::Derived);
        };
        let spec = Spec::read(text).map_err(|e| SystemError::Spec(name.clone(), e.trim().replace('\n', " ")))?;
        if spec.floating != robot.floating() {
            let said = format!("floating = {}, but the robot's base is {}", spec.floating, if robot.floating() { "free" } else { "fixed" });
            return Err(SystemError::Spec(name, said));
        }
        Self::new(&name, robot, spec, Source::Told)
    }

    /// From the text of a URDF alone: gravity along -z, 1/60 s, no torque.
    pub fn bare(name: &str, urdf: &str, floating: bool) -> Result<Self, SystemError> {
        Self::bare_at(name, urdf, floating, None)
    }

    /// The same, its meshes found from where the URDF is.
    pub(crate) fn bare_at(name: &str, urdf: &str, floating: bool, path: Option<&Path>) -> Result<Self, SystemError> {
        let mut robot = Robot::from_urdf_alone(urdf, floating).map_err(|e| SystemError::Urdf(name.into(), e))?;
        let spec = plain(&robot);
        touch(&mut robot, path, spec.mesh_points);
        Self::new(name, robot, spec, Source::Derived)
    }

    /// From a robot, and a specification that nobody has looked at yet.
    pub(crate) fn new(name: &str, mut robot: Robot, mut spec: Spec, source: Source) -> Result<Self, SystemError> {
        let wrong = |text: String| SystemError::Spec(name.into(), text);
        name_columns(&robot, &mut spec);
        check(&spec, &robot).map_err(wrong)?;
        // From here on in the order of the coordinates.
        let places: HashMap<&str, usize> = robot.joints().enumerate().map(|(i, j)| (j.name.as_str(), i)).collect();
        spec.joints.sort_by_key(|joint| places.get(joint.name.as_str()).copied());
        if let Some(root) = &mut spec.root {
            upright(&mut root.quaternion);
        }
        equip(&mut robot, &spec, source != Source::Derived);
        let random = [("random_plane", spec.random_plane.is_some()), ("random_pegs", spec.random_pegs.is_some())];
        if let Some((key, _)) = random.into_iter().find(|(_, asked)| *asked && robot.contact_points.is_empty()) {
            return Err(wrong(format!("{key}: the robot has no contact point that could touch it; give it [[contact]] points")));
        }
        if let Some(vary) = &spec.vary {
            vary.fits(&robot).map_err(wrong)?;
        }
        let system = Self { name: name.into(), robot, frame_time: spec.seconds(), spec, source };
        system.spec.truth.check(&system).map_err(|e| wrong(format!("truth: {e}")))?;
        if let Some(scene) = &system.spec.data_scene {
            system.scene(scene)?;
        }
        for which in [Start::Sample, Start::Reset] {
            if clear_start(&system, which, &mut stream(0, 0), DRAWS).is_none() {
                let [law, remedy] = source.starts(system.spec.root.is_some(), which.name());
                return Err(wrong(format!("none of {DRAWS} starts of {law} stands clear of the data's scene: {remedy}")));
            }
        }
        Ok(system)
    }

    /// Refuses a system that differs from this one in more than numbers: a batch may hold both.
    ///
    /// # Errors
    /// In what.
    pub fn alike(&self, other: &Self) -> Result<(), String> {
        let (mine, its) = (&self.robot, &other.robot);
        let built = |robot: &Robot| -> Vec<_> {
            let link = |l: &Link| (l.parent, l.joint.as_ref().map(|j| (j.kind, j.mimic().map(|m| m.coordinate))));
            robot.links.iter().map(link).collect()
        };
        if built(mine) != built(its) || mine.floating() != its.floating() {
            return Err("its links or joints are others".into());
        }
        if !mine.contact_points.iter().map(|p| p.link).eq(its.contact_points.iter().map(|p| p.link)) {
            return Err("its contact points are on other links".into());
        }
        if self.frame_time != other.frame_time {
            return Err(format!("its frame takes {} s, not {} s", other.frame_time, self.frame_time));
        }
        Ok(())
    }

    /// The default state `[q, qd]`, at rest; a root of which nothing is said stands upright at the origin.
    pub fn default_state(&self) -> Vec<f64> {
        let mut state = self.robot.zero_state();
        if let Some(root) = &self.spec.root {
            state[..3].copy_from_slice(&root.position);
            state[3..7].copy_from_slice(&root.quaternion);
        }
        for (q, joint) in state[self.robot.root_coords()..].iter_mut().zip(self.joint_specs()) {
            *q = joint.default;
        }
        state
    }

    /// What the specification says of each joint, in the order of the coordinates.
    pub fn joint_specs(&self) -> impl Iterator<Item = &JointSpec> {
        self.spec.joints.iter()
    }

    /// Amplitude of random torques by joint (N m or N).
    pub fn torque_amplitudes(&self) -> Vec<f64> {
        self.joint_specs().map(|j| j.torque).collect()
    }

    /// Gravity (m/s^2).
    pub fn gravity(&self) -> Vector3<f64> {
        Vector3::from(self.spec.gravity)
    }

    /// Names of the robot's own scenes; beside them it has [`WORLDS`], if it has contact points.
    pub fn scene_names(&self) -> Vec<&str> {
        std::iter::once("free").chain(self.spec.scenes.iter().map(|s| s.name.as_str())).collect()
    }

    /// Scenes that motion is judged in: that of the training data if it is one, else all of the robot's.
    pub fn usual_scenes(&self) -> Vec<&str> {
        self.spec.data_scene.as_deref().map_or_else(|| self.scene_names(), |scene| vec![scene])
    }

    /// A scene by name: `free` is empty space, then the robot's own, then [`WORLDS`] of the robot's material.
    pub fn scene(&self, name: &str) -> Result<Arc<Scene>, SystemError> {
        let mut scene = Scene::free(self.gravity());
        if name != "free" {
            let Some(spec) = self.spec.scenes.iter().find(|s| s.name == name) else {
                let touches = !self.robot.contact_points.is_empty();
                let world = world(name, &scene.gravity, self.spec.material).filter(|_| touches);
                let known = self.scene_names().into_iter().chain(WORLDS.into_iter().filter(|_| touches));
                let mut known = known.collect::<Vec<_>>().join(", ");
                if !touches {
                    known += ", since it has nothing to touch with; give it [[contact]] points";
                }
                let world = world.ok_or_else(|| SystemError::Scene { robot: self.name.clone(), scene: name.into(), known })?;
                world.check().map_err(|e| SystemError::Spec(self.name.clone(), e))?;
                return Ok(Arc::new(world));
            };
            scene = described(spec, &scene.gravity, self.spec.material);
        }
        scene.check().map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(Arc::new(scene))
    }
}

/// Gives the robot what a checked specification says of it.
fn equip(robot: &mut Robot, spec: &Spec, told: bool) {
    let at = |robot: &Robot, name: &str| robot.links.iter().position(|l| l.name == name);
    if !spec.mass_matrix_of.is_empty() {
        let other = |l: &Link| spec.mass_matrix_of.get(&l.name).map_or(&l.name, |o| o).clone();
        robot.mass_matrix_of = robot.links.iter().filter_map(|l| at(robot, &other(l))).collect();
    }
    for (joint, said) in robot.joints_mut().zip(&spec.joints) {
        (joint.armature, joint.stiffness, joint.rest) = (said.armature, said.stiffness, said.rest);
        if let (Some(limit), Some(law)) = (&mut joint.limit, said.limit) {
            (limit.stiffness, limit.damping) = (law.stiffness, law.damping);
        }
    }
    let unsaid: Vec<bool> = spec.joints.iter().map(|j| j.limit.is_none()).collect();
    stiffen(robot, &unsaid, spec.seconds() / spec.substeps as f64);
    if !spec.contacts.is_empty() {
        let point = |c: &ContactSpec| {
            Some(ContactPoint { link: at(robot, &c.link)?, local: Vector3::from(c.point), radius: c.radius, thickness: c.thickness })
        };
        robot.contact_points = spec.contacts.iter().filter_map(point).collect();
    } else if told && spec.scenes.is_empty() && spec.random_plane.is_none() {
        // Said to have nothing to touch: the robot pays for no contact point.
        robot.contact_points.clear();
    }
}

/// Contact points of the collision meshes that a URDF's file names.
#[cfg(feature = "meshes")]
use crate::meshes::touch;
#[cfg(not(feature = "meshes"))]
fn touch(_: &mut Robot, _: Option<&Path>, _: usize) {}

/// Makes a quaternion a unit one; one that is so but for rounding stays as it is.
fn upright(quaternion: &mut [f64; 4]) {
    let size = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (size - 1.0).abs() > 1e-12 {
        quaternion.iter_mut().for_each(|x| *x /= size);
    }
}
