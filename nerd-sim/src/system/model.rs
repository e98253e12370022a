//! A system: a robot model together with its specification, built in or from files.

use nerd_core::robot::MeshFile;
use toml::Table;

use super::built_in::{BUILT_IN, CABLES, FAMILIES, FOREIGN};
use super::derive::rotor;
use super::validate::check;
use super::{folds::Folds, motors::Motors, spec::JointSpec};
use crate::internal::*;
use crate::scene::{PlaneSpec, SceneSpec, TerrainSpec, WORLDS, described, world};

/// The scene that [`System::with_terrain`] adds.
pub const TERRAIN: &str = "terrain";

/// Why a system could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// No such built-in robot, and no such file.
    #[error("no robot `{0}`: choose from {known}, or the path of a .urdf or MJCF (.xml; with a .toml beside it for what it cannot say) or of a cable's .toml", known = [System::built_in(), System::families(), System::cables()].concat().join(", "))]
    Unknown(String),
    /// No such scene.
    #[error("system `{0}` has no scene `{1}`: choose from {2}")]
    Scene(String, String, String),
    /// A file that could not be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The URDF cannot be honoured.
    #[error("robot `{0}`: {1}")]
    Urdf(String, UrdfError),
    /// The specification is wrong.
    #[error("specification of robot `{0}`: {1}")]
    Spec(String, String),
}

impl SystemError {
    /// What is wrong with a specification, in one line.
    pub(crate) fn spec(name: &str, text: impl ToString) -> Self {
        Self::Spec(name.into(), text.to_string().trim().replace('\n', " "))
    }
}

/// Where a system comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A robot whose specification was made up of its numbers.
    Derived,
    /// A robot with a specification of its own.
    Specified,
    /// `[cable]` ([`crate::cable`]).
    Cable,
}

impl Source {
    /// Where starts come from, of a system with a `[root]` or without, and what lifts them out of the ground.
    pub(crate) fn starts(self, rooted: bool, which: &str) -> [String; 2] {
        let raise = "raise it along the up axis, or ask for less clearance";
        match (self, rooted) {
            (Self::Cable, _) => [format!("[cable] at and along, and of its joints' {which} boxes,"), "change at or along".into()],
            (_, true) => [format!("[root.{which}]"), raise.into()],
            (_, false) => [format!("the joints' {which} boxes"), raise.into()],
        }
    }

    /// Why a frame could not be stepped, with what to change where that is known.
    pub(crate) fn lost(self, reason: String) -> String {
        match self {
            Self::Cable => format!("{reason} (raise [cable] damping or links, or substeps)"),
            Self::Derived | Self::Specified => reason,
        }
    }
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
    /// What was taken for granted of the robot, a line each.
    pub notes: Vec<String>,
    /// Collision meshes that nothing is touched with.
    pub meshes: Vec<MeshFile>,
    /// Shapes of a fixed base, in its frame, which are part of every scene but `free`.
    pub base: Vec<Shape>,
    /// What stands between its links and who drives it.
    pub motors: Motors,
    /// Its URDF, or its MJCF as one, and where the file is: for [`System::visuals`].
    pub(crate) file: (Arc<str>, Option<PathBuf>),
    /// What was drawn of its numbers, by [`crate::vary::columns`]; empty of a robot as its files have it.
    pub drawn: Vec<f64>,
    /// For each link, the link whose inertia moves in its place in the mass matrix; empty but for a simulator's slip imitated.
    pub(crate) stand_ins: Vec<usize>,
    pub(crate) folds: Folds,
}

impl System {
    /// Names of the robots that come with the crate; of cables, see [`System::cables`].
    pub fn built_in() -> Vec<&'static str> {
        BUILT_IN.iter().map(|b| b.0).collect()
    }

    /// Names of the families of robots that come with the crate, whose numbers are drawn ([`crate::vary`]).
    pub fn families() -> Vec<&'static str> {
        FAMILIES.iter().map(|f| f.0).collect()
    }

    /// Names of the cables that come with the crate. Beside [`System::built_in`], they can be named wherever a robot is.
    pub fn cables() -> Vec<&'static str> {
        CABLES.iter().map(|c| c.0).collect()
    }

    /// Specification (TOML) and URDF of a built-in robot, for robots that are made of it.
    pub fn texts(name: &str) -> Option<(&'static str, &'static str)> {
        BUILT_IN.iter().find(|b| b.0 == name).map(|b| (b.1, b.2))
    }

    /// Working memory for its robot's dynamics.
    pub fn data(&self) -> Data {
        let mut data = Data::new(&self.robot);
        data.stand_ins.clone_from(&self.stand_ins);
        data
    }

    /// Whether something acts on it that no explicit step bears: dry friction, a spring, its own links.
    pub fn held(&self) -> bool {
        self.robot.dry() || self.robot.sprung() || !self.folds.is_empty()
    }

    /// Whether what a policy sees of its robots has noise or is late.
    pub fn sensed(&self) -> bool {
        self.noisy() || self.spec.vary.as_ref().is_some_and(|vary| vary.lag.is_some())
    }

    /// Whether its robots are pushed.
    pub fn pushed(&self) -> bool {
        self.spec.vary.as_ref().is_some_and(|vary| vary.push.is_some())
    }

    /// Whether sensors of its robots have noise.
    pub fn noisy(&self) -> bool {
        self.spec.vary.as_ref().is_some_and(super::vary::VarySpec::noisy)
    }

    /// Its specification as TOML: with `urdf = ...` it can be put beside the file and edited.
    pub fn spec_text(&self) -> String {
        if self.source != Source::Cable {
            return toml::to_string(&self.spec).unwrap_or_default();
        }
        // Besides `[cable]` only the keys that apply to a cable.
        let mut keys = Table::try_from(&self.spec).unwrap_or_default();
        keys.retain(|key, _| FOREIGN.iter().all(|(foreign, _)| *foreign != key));
        toml::to_string(&keys).unwrap_or_default()
    }

    /// Refuses a system that differs from this one in more than numbers: a batch may hold both.
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

    /// The default state `[q, qd]`, at rest; by default the root is upright at the origin.
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

    /// Energy (J) in the springs of contacts, joints and their limits at a state: `k g^2 / 2` at the depth g of each.
    pub fn stored(&self, scene: &Scene, state: &[f64], data: &mut Data) -> f64 {
        let (robot, mut events) = (&self.robot, Vec::new());
        contacts(robot, scene, state, data, &mut events);
        let touching = robot.contact_points.iter().zip(&events).filter(|(point, event)| event.distance < point.radius);
        let pressed = touching.map(|(point, event)| {
            let k = scene.colliders[event.collider].material.mean(&self.spec.material).stiffness;
            0.5 * k * (event.distance - point.radius).powi(2)
        });
        let joints = || state[robot.root_coords()..].iter().zip(robot.joints());
        let bent = joints().filter_map(|(q, j)| j.limit.map(|l| 0.5 * l.stiffness * (q - q.clamp(l.lower, l.upper)).powi(2)));
        let sprung = joints().map(|(q, j)| 0.5 * j.stiffness * (q - j.rest).powi(2));
        pressed.sum::<f64>() + bent.sum::<f64>() + sprung.sum::<f64>()
    }

    /// What the specification says of each joint, in the order of the coordinates.
    pub fn joint_specs(&self) -> impl Iterator<Item = &JointSpec> {
        self.spec.joints.iter()
    }

    /// Amplitude of random torques by joint (N m or N).
    pub fn torque_amplitudes(&self) -> Vec<f64> {
        self.joint_specs().map(|j| j.torque).collect()
    }

    /// The same with a rotor at each joint that has none, by what its motor can do: the guess for a joint that nothing else resists.
    /// No URDF has rotors, and light links without them ask for short steps.
    pub fn with_rotors(mut self) -> Self {
        for (joint, spec) in self.robot.joints_mut().zip(&mut self.spec.joints).filter(|(joint, _)| joint.armature == 0.0) {
            spec.armature = rotor(joint, spec.gain);
            joint.armature = spec.armature;
        }
        self
    }

    /// The same with frames of another time (s), or of other substeps.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn paced(&self, frame_time: Option<f64>, substeps: Option<usize>) -> Result<Self, SystemError> {
        let mut own = self.clone();
        own.spec.frame_time = frame_time.map_or(own.spec.frame_time, |time| time.to_string());
        own.spec.substeps = substeps.unwrap_or(own.spec.substeps);
        own.frame_time = own.spec.seconds();
        check(&own.spec, &own.robot).map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(own)
    }

    /// The same with a scene `terrain` beside its own: ground like that, and nothing on it.
    ///
    /// # Errors
    /// If a number of it is out of its range.
    pub fn with_terrain(mut self, terrain: TerrainSpec) -> Result<Self, SystemError> {
        let plane = PlaneSpec { height: 0.0, angles: [0.0; 3] };
        self.spec.scenes.retain(|scene| scene.name != TERRAIN);
        let scene = SceneSpec { name: TERRAIN.into(), plane, terrain: Some(terrain), boxes: Vec::new(), pegs: Vec::new(), material: None };
        self.spec.scenes.push(scene);
        check(&self.spec, &self.robot).map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(self)
    }

    /// Gravity (m/s^2).
    pub fn gravity(&self) -> Vector3<f64> {
        Vector3::from(self.spec.gravity)
    }

    /// Names of all scenes: the robot's own, and [`WORLDS`] if it has contact points.
    pub fn all_scenes(&self) -> Vec<&str> {
        let worlds = WORLDS.into_iter().filter(|_| !self.robot.contact_points.is_empty());
        self.scene_names().into_iter().chain(worlds).collect()
    }

    /// Names of the robot's own scenes.
    pub fn scene_names(&self) -> Vec<&str> {
        let base = (!self.base.is_empty()).then_some("base");
        std::iter::once("free").chain(base).chain(self.spec.scenes.iter().map(|s| s.name.as_str())).collect()
    }

    /// Scenes that motion is judged in: that of the training data if it is one, else all of the robot's.
    pub fn usual_scenes(&self) -> Vec<&str> {
        self.spec.data_scene.as_deref().map_or_else(|| self.scene_names(), |scene| vec![scene])
    }

    /// A scene by name: `free` is empty space, `base` the fixed base of a robot whose file gives it shapes, then the robot's own, then [`WORLDS`] of the robot's material.
    pub fn scene(&self, name: &str) -> Result<Arc<Scene>, SystemError> {
        let (gravity, material, touches) = (self.gravity(), self.spec.material, !self.robot.contact_points.is_empty());
        let scene = match self.spec.scenes.iter().find(|s| s.name == name) {
            Some(spec) => Some(described(spec, &gravity, material).map_err(|e| SystemError::Spec(self.name.clone(), e))?),
            None if name == "free" => return Ok(Arc::new(Scene::free(gravity))),
            None if name == "base" && !self.base.is_empty() => Some(Scene { name: name.into(), ..Scene::free(gravity) }),
            None => world(name, &gravity, material).filter(|_| touches),
        };
        let Some(mut scene) = scene else {
            let known = self.all_scenes().join(", ");
            let why = if touches { "" } else { ", since it has nothing to touch with; give it [[contact]] points" };
            return Err(SystemError::Scene(self.name.clone(), name.into(), known + why));
        };
        if let Base::Fixed(at) = &self.robot.base {
            scene.colliders.extend(self.base.iter().map(|shape| Collider::shaped(shape, at, material)));
        }
        scene.check().map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(Arc::new(scene))
    }
}
