//! Gradients of a free root that rotates fast.

use super::*;

/// Two cases rotate about a centre of mass away from the root's origin.
#[test]
fn gradients_know_a_root_that_spins() {
    let off = altered("anymal", |system| system.robot.links[0].inertia.com = Vector3::new(0.05, -0.02, 0.1));
    for (system, scene, spin) in [(&off, "ground", 6.0), (&built_in("cube"), "ground", 40.0), (&off, "free", 20.0)] {
        let (mut batch, nq) = (begun(system, scene, 4), system.robot.nq());
        batch.states.chunks_exact_mut(system.robot.state_dim()).enumerate().for_each(|(env, state)| {
            (state[nq], state[nq + 1], state[nq + 2]) = (spin, 0.5 * spin * (env as f64).sin(), -0.7 * spin);
        });
        check(&format!("{} that spins, {scene}", system.name), batch, 30, EXACT);
    }
}
