//! Contact filters and friction from a robot's file, applied to rapier's contact pairs.

use rapier3d_f64::prelude::*;

use crate::internal::*;

/// Marks a robot collider with a surface of the robot's file; the lower 64 bits hold the surface number.
const OF_FILE: u128 = 1 << 64;

/// Reason for refusing torsional and rolling friction.
pub(super) const TURNS: &str =
    "torsional or rolling friction is asked for, which rapier has not; step with articulated";

/// Whether a material has torsional or rolling friction.
pub(super) fn turns(material: &Material) -> bool {
    material.torsion > 0.0 || material.rolling > 0.0
}

/// Attaches a surface of the robot's file, if given, to a robot collider. The collider's margin (m) is the file's
/// margin against the ground.
pub(super) fn of_file(system: &System, builder: ColliderBuilder, surface: Option<usize>) -> ColliderBuilder {
    let Some(surface) = surface.filter(|own| *own < system.surfaces.geoms.len()) else { return builder };
    let margin = system.surfaces.other(surface).map_or(0.0, |law| law.margin);
    let hooks = ActiveHooks::FILTER_CONTACT_PAIRS | ActiveHooks::MODIFY_SOLVER_CONTACTS;
    builder.user_data(OF_FILE | surface as u128).contact_skin(margin.max(0.0)).active_hooks(hooks)
}

/// A robot and its scene, for rapier's contact hooks.
pub(super) struct Pairs<'a> {
    pub(super) system: &'a System,
    pub(super) scene: &'a Scene,
}

impl Pairs<'_> {
    /// Material of two colliders; `None` if they never collide.
    fn material(&self, colliders: &ColliderSet, pair: [ColliderHandle; 2]) -> Option<Material> {
        let data = pair.map(|handle| colliders.get(handle).map_or(0, |c| c.user_data));
        let [robot, scene] = if data[0] & OF_FILE != 0 { data } else { [data[1], data[0]] };
        let point = ContactPoint::new(0, nalgebra::Vector3::zeros(), 0.0).on(Some((robot & !OF_FILE) as usize));
        self.system.meeting(&point, self.scene.colliders.get(scene as usize)?)
    }
}

impl PhysicsHooks for Pairs<'_> {
    fn filter_contact_pair(&self, pair: &PairFilterContext) -> Option<SolverFlags> {
        self.material(pair.colliders, [pair.collider1, pair.collider2]).map(|_| SolverFlags::COMPUTE_RIGID_IMPULSES)
    }

    fn modify_solver_contacts(&self, pair: &mut ContactModificationContext) {
        let material = self.material(pair.colliders, [pair.collider1, pair.collider2]);
        if let Some((material, manifold)) = material.zip(pair.rigid_mut()) {
            *manifold.friction = material.friction;
        }
    }
}
