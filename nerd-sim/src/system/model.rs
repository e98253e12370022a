//! A system: a robot model with its specification, built in or from files.

use nerd_core::robot::{Bodies, MeshFile};
use toml::Table;

use super::built_in::{BUILT_IN, CABLES, FAMILIES, FOREIGN};
use super::folds::Folds;
use super::validate::check;
use crate::internal::*;
use crate::robots::derive::rotor;
use crate::robots::{motors::Motors, spec::JointSpec};
use crate::scene::{GROUND, PlaneSpec, SceneSpec, Surfaces, TerrainSpec, WORLDS, described, world};

/// Name of the scene that [`System::with_terrain`] adds.
pub const TERRAIN: &str = "terrain";

/// Errors of making a system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// Neither a built-in robot nor a file has this name.
    #[error("no robot `{0}`: choose from {known}, or the path of a .urdf or MJCF (.xml; with a .toml beside it for what it cannot say) or of a cable's .toml", known = [System::built_in(), System::families(), System::cables()].concat().join(", "))]
    Unknown(String),
    /// The system has no scene of this name. Fields: system, scene, known scenes.
    #[error("system `{0}` has no scene `{1}`: choose from {2}")]
    Scene(String, String, String),
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The URDF or MJCF cannot be represented.
    #[error("robot `{0}`: {1}")]
    Urdf(String, UrdfError),
    /// The specification is invalid.
    #[error("specification of robot `{0}`: {1}")]
    Spec(String, String),
    /// No start is clear of the training data's scene. Fields: robot, number and kind of starts, scene, advice.
    #[error("robot `{0}`: none of its {1} is clear of scene `{2}`: {3}")]
    Blocked(String, String, String, String),
}

impl SystemError {
    /// An error in a specification, as one line.
    pub(crate) fn spec(name: &str, text: impl ToString) -> Self {
        Self::Spec(name.into(), text.to_string().trim().replace('\n', " "))
    }
}

/// Origin of a system's specification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Derived from the robot's file.
    Derived,
    /// Written in a TOML for this robot.
    Specified,
    /// A data sheet `[cable]` ([`crate::cable`]).
    Cable,
}

impl Source {
    /// Returns two texts for an error: the ranges of a system's starts, and advice that would bring the starts clear of
    /// the scene. `rooted`: whether the system has `[root]`.
    pub(crate) fn starts(self, rooted: bool, which: &str) -> [String; 2] {
        let raise = "raise it along the up axis, or ask for less clearance";
        match (self, rooted) {
            (Self::Cable, _) => [
                format!("of [cable] position and direction, and of its joints' {which} boxes,"),
                "change position or direction".into(),
            ],
            (_, true) => [format!("of [root.{which}]"), raise.into()],
            (_, false) => [format!("of the joints' `{which}`"), "narrow them, or move the scene".into()],
        }
    }

    /// Adds advice to the reason why a frame could not be stepped, if there is advice.
    pub(crate) fn lost(self, reason: String) -> String {
        match self {
            Self::Cable => format!("{reason} (raise [cable] damping or links, or substeps)"),
            Self::Derived | Self::Specified => reason,
        }
    }
}

/// A robot with its control, sampling, scenes and sensors.
#[derive(Clone, Debug)]
pub struct System {
    /// Name, as on the command line.
    pub name: String,
    /// Robot model, with armature, limits and contact points of the specification.
    pub robot: Robot,
    /// The specification.
    pub spec: Spec,
    /// Frame time (s): duration of a control step.
    pub frame_time: f64,
    /// Origin of the specification.
    pub source: Source,
    /// Assumptions made about the robot, one line each.
    pub notes: Vec<String>,
    /// Collision meshes not used for contact.
    pub meshes: Vec<MeshFile>,
    /// Shapes of a fixed base, in the base frame; part of every scene except `free`.
    pub base: Vec<Shape>,
    /// Static objects in the world of the robot's file; they form the scene [`GROUND`].
    pub world: Vec<Collider>,
    /// Contact laws between geoms of the robot's file.
    pub surfaces: Arc<Surfaces>,
    /// Largest contact margin (m) of the laws in `surfaces`.
    pub(crate) margin: f64,
    /// Friction coefficient of all contacts with a law in `surfaces`, if it is drawn or fitted.
    pub one_friction: Option<f64>,
    /// Actuator and sensor model.
    pub motors: Motors,
    /// Bodies and path of the robot's file, for [`System::visuals`].
    pub(crate) file: (Arc<Bodies>, Option<PathBuf>),
    /// Drawn parameters, by [`crate::vary::columns`]; empty for the nominal robot.
    pub drawn: Vec<f64>,
    /// For each link, index of the link whose inertia replaces its own in the mass matrix. Empty unless a simulator's
    /// fault is reproduced.
    pub(crate) stand_ins: Vec<usize>,
    pub(crate) folds: Folds,
}

impl System {
    /// Names of built-in robots; for cables see [`System::cables`].
    pub fn built_in() -> Vec<&'static str> {
        BUILT_IN.iter().map(|b| b.0).collect()
    }

    /// Names of built-in families of robots with drawn parameters ([`crate::vary`]).
    pub fn families() -> Vec<&'static str> {
        FAMILIES.iter().map(|f| f.0).collect()
    }

    /// Names of built-in cables, usable wherever a robot is named.
    pub fn cables() -> Vec<&'static str> {
        CABLES.iter().map(|c| c.0).collect()
    }

    /// Specification (TOML) and URDF of a built-in robot, for robots based on it.
    pub fn texts(name: &str) -> Option<(&'static str, &'static str)> {
        BUILT_IN.iter().find(|b| b.0 == name).map(|b| (b.1, b.2))
    }

    /// Working memory for dynamics of this robot.
    pub fn data(&self) -> Data {
        let mut data = Data::new(&self.robot);
        data.stand_ins.clone_from(&self.stand_ins);
        data
    }

    /// Whether a force acts on the robot that explicit integrators do not support: dry friction, a joint spring,
    /// self-collision. Then `articulated` takes implicit substeps in every frame.
    pub fn held(&self) -> bool {
        self.robot.dry() || self.robot.sprung() || !self.folds.is_empty()
    }

    /// Whether a policy's observations are noisy or delayed.
    pub fn sensed(&self) -> bool {
        self.noisy() || self.spec.vary.as_ref().is_some_and(|vary| vary.lag.is_some())
    }

    /// Whether episodes have pushes.
    pub fn pushed(&self) -> bool {
        self.spec.vary.as_ref().is_some_and(|vary| vary.push.is_some())
    }

    /// Whether sensors have noise.
    pub fn noisy(&self) -> bool {
        self.spec.vary.as_ref().is_some_and(crate::robots::vary::VarySpec::noisy)
    }

    /// The specification as TOML: with a line `urdf = ...`, this text can be put beside the robot's file and edited.
    pub fn spec_text(&self) -> String {
        if self.source != Source::Cable {
            return toml::to_string(&self.spec).unwrap_or_default();
        }
        // Besides `[cable]`, only keys that apply to a cable.
        let mut keys = Table::try_from(&self.spec).unwrap_or_default();
        keys.retain(|key, _| FOREIGN.iter().all(|(foreign, _)| *foreign != key));
        toml::to_string(&keys).unwrap_or_default()
    }

    /// Refuses a system that cannot share a batch with this one: only parameters may differ, not links, joints or frame
    /// time.
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

    /// The default state `[q, qd]` with zero velocities. Without `[root]`, a floating root is upright at the origin.
    pub fn default_state(&self) -> Vec<f64> {
        let mut state = self.robot.zero_state();
        if let Some(root) = &self.spec.root {
            state[..3].copy_from_slice(&root.position);
            state[3..7].copy_from_slice(&root.quaternion);
        }
        for (q, joint) in state[self.robot.root_coords()..].iter_mut().zip(self.joint_specs()) {
            *q = joint.default_q;
        }
        state
    }

    /// Specification of each joint, in the order of the coordinates.
    pub fn joint_specs(&self) -> impl Iterator<Item = &JointSpec> {
        self.spec.joints.iter()
    }

    /// Torque limit (N m or N) of the position law at a joint: infinite without `clamp`.
    pub fn torque_limit(&self, joint: usize) -> f64 {
        let clamped = self.spec.control.is_some_and(|law| law.clamp);
        self.spec
            .joints
            .get(joint)
            .filter(|_| clamped)
            .map_or(f64::INFINITY, |joint| joint.gain.unwrap_or(joint.torque))
    }

    /// Amplitude of random torques by joint (N m or N).
    pub fn torque_amplitudes(&self) -> Vec<f64> {
        self.joint_specs().map(|j| j.torque).collect()
    }

    /// The system with a rotor inertia at each joint without armature, sized by the joint's motor. URDF has no rotors,
    /// and light links without rotors need short steps. Armatures of an MJCF stay unchanged.
    pub fn with_rotors(mut self) -> Self {
        if !self.surfaces.is_empty() {
            return self;
        }
        for (joint, spec) in
            self.robot.joints_mut().zip(&mut self.spec.joints).filter(|(joint, _)| joint.armature == 0.0)
        {
            spec.armature = rotor(joint, spec.gain);
            joint.armature = spec.armature;
        }
        self
    }

    /// The system with another frame time (s) or number of substeps.
    ///
    /// # Errors
    /// If a value is out of range.
    pub fn paced(&self, frame_time: Option<f64>, substeps: Option<usize>) -> Result<Self, SystemError> {
        let mut own = self.clone();
        own.spec.frame_time = frame_time.map_or(own.spec.frame_time, |time| time.to_string());
        own.spec.substeps = substeps.unwrap_or(own.spec.substeps);
        own.frame_time = own.spec.seconds();
        check(&own.spec, &own.robot).map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(own)
    }

    /// The system with an added scene `terrain`: the ground that `terrain` describes, without objects.
    ///
    /// # Errors
    /// If a number of `terrain` is out of range.
    pub fn with_terrain(mut self, terrain: TerrainSpec) -> Result<Self, SystemError> {
        let plane = PlaneSpec { height: 0.0, angles: [0.0; 3] };
        self.spec.scenes.retain(|scene| scene.name != TERRAIN);
        let scene = SceneSpec {
            name: TERRAIN.into(),
            plane,
            terrain: Some(terrain),
            boxes: Vec::new(),
            pegs: Vec::new(),
            material: None,
        };
        self.spec.scenes.push(scene);
        check(&self.spec, &self.robot).map_err(|e| SystemError::Spec(self.name.clone(), e))?;
        Ok(self)
    }

    /// Gravity (m/s^2).
    pub fn gravity(&self) -> Vector3<f64> {
        Vector3::from(self.spec.gravity)
    }

    /// Names of all scenes: the robot's own, and [`WORLDS`] if the robot has contact points.
    pub fn all_scenes(&self) -> Vec<&str> {
        let worlds = WORLDS.into_iter().filter(|_| !self.robot.contact_points.is_empty());
        self.scene_names().into_iter().chain(worlds).collect()
    }

    /// Names of the robot's own scenes.
    pub fn scene_names(&self) -> Vec<&str> {
        let base = (!self.base.is_empty()).then_some("base");
        let own = !self.world.is_empty() && self.spec.scenes.iter().all(|scene| scene.name != GROUND);
        std::iter::once("free")
            .chain(base)
            .chain(own.then_some(GROUND))
            .chain(self.spec.scenes.iter().map(|s| s.name.as_str()))
            .collect()
    }

    /// Scenes for evaluation: the scene of the training data if set, else all of the robot's own.
    pub fn usual_scenes(&self) -> Vec<&str> {
        self.spec.data_scene.as_deref().map_or_else(|| self.scene_names(), |scene| vec![scene])
    }

    /// A scene by name. `free` is empty space, `base` the shapes of a fixed base; then come the robot's own scenes,
    /// then [`WORLDS`] with the robot's material.
    pub fn scene(&self, name: &str) -> Result<Arc<Scene>, SystemError> {
        let gravity = self.gravity();
        let material = self.spec.material;
        let touches = !self.robot.contact_points.is_empty();
        let scene = match self.spec.scenes.iter().find(|s| s.name == name) {
            Some(spec) => {
                Some(described(spec, &gravity, material).map_err(|e| SystemError::Spec(self.name.clone(), e))?)
            }
            None if name == "free" => return Ok(Arc::new(Scene::free(gravity))),
            None if name == GROUND && !self.world.is_empty() => {
                let own = |collider: &Collider| Collider { material, ..collider.clone() };
                Some(Scene { name: name.into(), gravity, colliders: self.world.iter().map(own).collect() })
            }
            None if name == "base" && !self.base.is_empty() => {
                Some(Scene { name: name.into(), ..Scene::free(gravity) })
            }
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
