//! A coarse frame for a network to correct: a few implicit substeps in which every contact point meets the plane found at the frame's
//! start. It is cheap, stable and of second order, and needs no scene but those contacts. Without contact points it is as many substeps
//! of Runge-Kutta.

use nalgebra::Vector3;
use nerd_core::contact::ContactEvent;

use super::config::{ArticulatedConfig, Friction};
use super::workspace::Workspace;
use crate::scene::{Collider, Material, Plane, Scene};
use crate::solver::parallel::Frame as _;
use crate::system::{System, SystemError};

/// Working memory of one environment at a time; nothing in it outlives a frame.
pub struct Draft {
    workspace: Workspace,
    config: ArticulatedConfig,
    scene: Scene,
}

impl Draft {
    /// Substeps that a draft may have; with more it would be no cheaper than what it is a draft of.
    pub const MOST: usize = 64;

    /// Drafts of so many substeps for a system, on the material of its data's scene.
    ///
    /// # Errors
    /// If the system has no such scene, cannot be stepped, or not in so many substeps.
    pub fn new(system: &System, substeps: usize) -> Result<Self, SystemError> {
        let (config, material) = Self::settings(system, substeps)?;
        let mut scene = Scene::free(system.gravity());
        // Represents what the points face.
        scene.colliders.push(Collider::plane(Plane { normal: Vector3::y(), offset: 0.0 }, material));
        let known = Workspace::prepare(system).map_err(|e| SystemError::Spec(system.name.clone(), e))?;
        let workspace = Workspace::new(system, known);
        Ok(Self { workspace, config, scene })
    }

    /// The settings of a draft, and the material of what its points face.
    ///
    /// # Errors
    /// As [`Draft::new`].
    pub fn settings(system: &System, substeps: usize) -> Result<(ArticulatedConfig, Material), SystemError> {
        if !(1..=Self::MOST).contains(&substeps) {
            let reason = format!("a draft of {substeps} substeps, 1 to {} are possible", Self::MOST);
            return Err(SystemError::Spec(system.name.clone(), reason));
        }
        let data = system.scene(system.spec.data_scene.as_deref().unwrap_or("free"))?;
        let material = data.colliders.first().map_or(system.spec.material, |c| c.material);
        Ok((ArticulatedConfig { substeps, ..ArticulatedConfig::implicit(substeps, Friction::Coulomb) }, material))
    }

    /// Moves `state` by a frame under torques `tau` and `gravity` (m/s^2). `events` are those of the contact points in order,
    /// found at `state`; far ones may be infinitely far.
    ///
    /// # Errors
    /// Why it cannot be moved; the state is then nothing.
    pub fn step(
        &mut self,
        system: &System,
        gravity: &Vector3<f64>,
        events: &[ContactEvent],
        tau: &[f64],
        state: &mut [f64],
    ) -> Result<(), String> {
        self.scene.gravity = *gravity;
        if system.robot.contact_points.is_empty() {
            return self.workspace.attempt(system, &self.scene, &self.config, false, state, tau);
        }
        self.workspace.face(system, &self.scene, events);
        let (config, substeps) = (self.config, self.config.contact_substeps);
        self.workspace.implicit(system, &self.scene, &config, substeps, true, state, tau)
    }
}
