//! One frame of one environment: explicit substeps, or implicit ones where they are asked for or something is too stiff.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::spatial::Wrench;

use super::config::{ArticulatedConfig, ContactStep};
use super::stiff::Bounds;
use super::workspace::Workspace;
use crate::drive::Drive;
use crate::scene::Scene;
use crate::solver::parallel::Frame;
use crate::system::System;

impl Frame for Workspace {
    type Config = ArticulatedConfig;
    type Prepared = Bounds;
    const CHUNK: usize = 64;
    const DRIVEN: bool = true;

    fn prepare(system: &System) -> Result<Arc<Bounds>, String> {
        Ok(Arc::new(Bounds::new(system)))
    }

    fn new(system: &System, known: Arc<Bounds>) -> Self {
        Self::of(system, known)
    }

    fn turn_to(&mut self, known: &Arc<Bounds>) {
        self.stiff.bounds.clone_from(known);
    }

    fn drive(&mut self, drives: &[Drive]) {
        self.drives.clear();
        self.drives.extend_from_slice(drives);
    }

    fn forces(&self) -> &[Vector3<f64>] {
        &self.forces
    }

    fn step(&mut self, system: &System, scene: &Scene, config: &ArticulatedConfig, state: &mut [f64], tau: &[f64]) -> Result<(), String> {
        let robot = &system.robot;
        // The environment stepped before this one may have touched something.
        self.data.external.fill(Wrench::default());
        self.forces.fill(Vector3::zeros());
        let contact = !scene.colliders.is_empty() && !robot.contact_points.is_empty();
        self.materials.clear();
        if contact {
            self.materials.extend(scene.colliders.iter().map(|c| c.material.mean(&system.spec.material)));
            let most = robot.contact_points.len() * scene.colliders.len();
            self.events.clear();
            // As many again are held for a moment while the covered ones are left out.
            self.events.reserve(most + scene.colliders.len());
            self.owners.clear();
            self.owners.reserve(most);
            self.owners.extend(0..robot.contact_points.len());
        }
        // Dry friction is stiff at rest, and a spring, a drive or a link on another may be: the implicit step alone holds them.
        if system.held() || !self.drives.is_empty() || contact && config.contact_step == ContactStep::Implicit {
            return self.implicit(system, scene, config, config.contact_substeps, false, state, tau);
        }
        self.start.copy_from_slice(state);
        self.stiff.begin();
        if self.explicit(system, scene, config, contact, state, tau)? {
            return Ok(());
        }
        // A damper, a limit or a friction was met that no explicit substep of this length can bear.
        state.copy_from_slice(&self.start);
        self.data.external.fill(Wrench::default());
        self.forces.fill(Vector3::zeros());
        self.implicit(system, scene, config, config.substeps.max(config.contact_substeps), false, state, tau)
    }
}
