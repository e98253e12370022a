//! A system: a robot model together with its specification, built in or from files.

use nerd_core::robot::{Bodies, MeshFile};
use toml::Table;

use super::built_in::{BUILT_IN, CABLES, FAMILIES, FOREIGN};
use super::derive::rotor;
use super::validate::check;
use super::{folds::Folds, motors::Motors, spec::JointSpec};
use crate::internal::*;
use crate::scene::{GROUND, PlaneSpec, SceneSpec, Surfaces, TerrainSpec, WORLDS, described, world};

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
    /// No start was found that is clear of the data's scene. Fields: the robot, the number and kind of starts, the scene, the advice.
    #[error("robot `{0}`: none of its {1} is clear of scene `{2}`: {3}")]
    Blocked(String, String, String, String),
}

impl SystemError {
    /// An error in a specification, in one line.
    pub(crate) fn spec(name: &str, text: impl ToString) -> Self {
        Self::Spec(name.into(), text.to_string().trim().replace('\n', " "))
    }
}

/// Where a system comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A robot whose specification was derived from its numbers.
    Derived,
    /// A robot with a specification of its own.
    Specified,
    /// `[cable]` ([`crate::cable`]).
    Cable,
}

impl Source {
    /// The source of starts, for a system with a `[root]` or without, and the setting that lifts them out of the ground.
    pub(crate) fn starts(self, rooted: bool, which: &str) -> [String; 2] {
        let raise = "raise it along the up axis, or ask for less clearance";
        match (self, rooted) {
            (Self::Cable, _) => [format!("of [cable] at and along, and of its joints' {which} boxes,"), "change at or along".into()],
            (_, true) => [format!("of [root.{which}]"), raise.into()],
            (_, false) => [format!("of the joints' `{which}`"), "narrow them, or move the scene".into()],
        }
    }

    /// Extends the reason why a frame could not be stepped by advice, where there is some.
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
    /// Origin of the specification.
    pub source: Source,
    /// Assumptions made about the robot, a line each.
    pub notes: Vec<String>,
    /// Collision meshes that are not used for contact.
    pub meshes: Vec<MeshFile>,
    /// Shapes of a fixed base, in its frame, which are part of every scene but `free`.
    pub base: Vec<Shape>,
    /// Static objects of its file's world: its scene [`GROUND`].
    pub world: Vec<Collider>,
    /// Contact laws of its file's geoms.
    pub surfaces: Arc<Surfaces>,
    /// Largest margin of a contact between them (m).
    pub(crate) margin: f64,
    /// Friction of all their contacts, if it was drawn or fitted.
    pub one_friction: Option<f64>,
    /// Its actuators and sensors.
    pub motors: Motors,
    /// Bodies and path of its file: for [`System::visuals`].
    pub(crate) file: (Arc<Bodies>, Option<PathBuf>),
    /// Drawn parameters, by [`crate::vary::columns`]; empty for a robot as its files have it.
    pub drawn: Vec<f64>,
    /// For each link, the link whose inertia replaces its own in the mass matrix; empty unless a simulator's fault is imitated.
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

    /// Names of the cables that come with the crate. As [`System::built_in`], they can be used wherever a robot is named.
    pub fn cables() -> Vec<&'static str> {
        CABLES.iter().map(|c| c.0).collect()
    }

    /// Specification (TOML) and URDF of a built-in robot, for robots based on it.
    pub fn texts(name: &str) -> Option<(&'static str, &'static str)> {
        BUILT_IN.iter().find(|b| b.0 == name).map(|b| (b.1, b.2))
    }

    /// Working memory for its robot's dynamics.
    pub fn data(&self) -> Data {
        let mut data = Data::new(&self.robot);
        data.stand_ins.clone_from(&self.stand_ins);
        data
    }

    /// Whether a force acts on it that no explicit step supports: dry friction, a spring, contact of its own links.
    pub fn held(&self) -> bool {
        self.robot.dry() || self.robot.sprung() || !self.folds.is_empty()
    }

    /// Whether a policy's observations of its robots are noisy or delayed.
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

    /// The specification of each joint, in the order of the coordinates.
    pub fn joint_specs(&self) -> impl Iterator<Item = &JointSpec> {
        self.spec.joints.iter()
    }

    /// Largest torque (N m or N) of the position law at a joint: infinite without `clamp`.
    pub fn most(&self, joint: usize) -> f64 {
        let clamped = self.spec.control.is_some_and(|law| law.clamp);
        self.spec.joints.get(joint).filter(|_| clamped).map_or(f64::INFINITY, |joint| joint.gain.unwrap_or(joint.torque))
    }

    /// Amplitude of random torques by joint (N m or N).
    pub fn torque_amplitudes(&self) -> Vec<f64> {
        self.joint_specs().map(|j| j.torque).collect()
    }

    /// The same with a rotor at each joint without armature, sized by the joint's motor, as for a joint without any other inertia. No URDF
    /// has rotors, and light links without them need short steps. The armatures of an MJCF are kept.
    pub fn with_rotors(mut self) -> Self {
        if !self.surfaces.is_empty() {
            return self;
        }
        for (joint, spec) in self.robot.joints_mut().zip(&mut self.spec.joints).filter(|(joint, _)| joint.armature == 0.0) {
            spec.armature = rotor(joint, spec.gain);
            joint.armature = spec.armature;
        }
        self
    }

    /// The same with another frame time (s), or other substeps.
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

    /// The same with a further scene `terrain`: ground of this kind, and nothing on it.
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
        let own = !self.world.is_empty() && self.spec.scenes.iter().all(|scene| scene.name != GROUND);
        std::iter::once("free").chain(base).chain(own.then_some(GROUND)).chain(self.spec.scenes.iter().map(|s| s.name.as_str())).collect()
    }

    /// Scenes for evaluation: the training data's if it is one of the robot's, else all of the robot's.
    pub fn usual_scenes(&self) -> Vec<&str> {
        self.spec.data_scene.as_deref().map_or_else(|| self.scene_names(), |scene| vec![scene])
    }

    /// A scene by name: `free` is empty space, `base` the fixed base of a robot whose file gives it shapes, then the robot's own scenes,
    /// then [`WORLDS`] with the robot's material.
    pub fn scene(&self, name: &str) -> Result<Arc<Scene>, SystemError> {
        let (gravity, material, touches) = (self.gravity(), self.spec.material, !self.robot.contact_points.is_empty());
        let scene = match self.spec.scenes.iter().find(|s| s.name == name) {
            Some(spec) => Some(described(spec, &gravity, material).map_err(|e| SystemError::Spec(self.name.clone(), e))?),
            None if name == "free" => return Ok(Arc::new(Scene::free(gravity))),
            None if name == GROUND && !self.world.is_empty() => {
                let own = |collider: &Collider| Collider { material, ..collider.clone() };
                Some(Scene { name: name.into(), gravity, colliders: self.world.iter().map(own).collect() })
            }
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
