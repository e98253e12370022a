//! Orders of convergence, without contact and with it.
//!
//! Without contact the solvers converge to one solution, each at the textbook order of its method. Classical
//! Runge-Kutta has order 4, symplectic Euler and rapier 1 (Hairer, Norsett, Wanner, *Solving ODEs I*, II.1 and II.3). A
//! wrong term in the dynamics gives an error that no substep removes, so the fitted order falls to 0.
//!
//! Bounds are 3.7..4.5 and 0.8..1.3, since a fit over a decade of substeps includes terms of the next order. The finest
//! setting must also be within 1e-7 (RK4) and 1e-2 (first order) of the reference, RK4 at 64 substeps.

use super::common::*;

const STARTS: usize = 16;

/// States after 20 frames under constant torques, from starts spread over a box.
fn solved(system: &Arc<System>, mut solver: impl Solver) -> Vec<f64> {
    let mut batch = batch(system, "free", STARTS);
    let (nq, joints) = (system.robot.nq(), system.robot.joint_count());
    for env in 0..STARTS {
        for (k, x) in batch.state_mut(env).iter_mut().enumerate() {
            let phase = (1.0 + env as f64) * (1.0 + k as f64) * 0.754_877_666;
            *x = (2.0 * phase.fract() - 1.0) * if k < nq { 1.5 } else { 2.0 };
        }
        if system.robot.floating() {
            let unit = quaternion(&batch.state(env)[3..7]);
            write_quaternion(&mut batch.state_mut(env)[3..7], &unit);
        }
    }
    // A free robot gets no torques: its light legs would spin up.
    let push = if system.robot.floating() { [0.0; 2] } else { [40.0, 5.0] };
    let torques: Vec<f64> = (0..STARTS * joints).map(|i| push[usize::from(i % joints > 0)]).collect();
    (0..20).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
    batch.states
}

fn articulated(integrator: Integrator, substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig { integrator, ..ArticulatedConfig::explicit(substeps, Friction::Coulomb) })
}

/// Mean |dq| between the states of two batches (rad or m).
fn apart(system: &System, a: &[f64], b: &[f64]) -> f64 {
    let (d, nq) = (system.robot.state_dim(), system.robot.nq());
    let root = std::iter::repeat_n(false, system.robot.root_coords());
    let wraps: Vec<bool> = root.chain(system.robot.joints().map(|j| j.wraps())).collect();
    let gap = |i: usize| if wraps[i % d] { wrap(a[i] - b[i]).abs() } else { (a[i] - b[i]).abs() };
    (0..a.len()).filter(|i| i % d < nq).map(gap).sum::<f64>() / (a.len() / d * nq) as f64
}

/// The order, fitted to log(error) over log(substeps), must be in `order`, and the error of the finest below `bound`.
fn converges<S: Solver>(
    system: &Arc<System>,
    substeps: [usize; 4],
    order: std::ops::Range<f64>,
    bound: f64,
    solver: impl Fn(usize) -> S,
) {
    let reference = solved(system, articulated(Integrator::Rk4, 64));
    let errors = substeps.map(|n| apart(system, &solved(system, solver(n)), &reference));
    let (x, y) = (substeps.map(|n| (n as f64).ln()), errors.map(f64::ln));
    let (mx, my) = (x.iter().sum::<f64>() / 4.0, y.iter().sum::<f64>() / 4.0);
    let slope = -x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>()
        / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>();
    assert!(
        order.contains(&slope),
        "{}: order {slope:.2}, textbook within {order:?}, by mean |dq| {errors:?}",
        system.name
    );
    assert!(errors[3] < bound, "{}: {:.2e} rad at {} substeps, bound {bound:.0e}", system.name, errors[3], substeps[3]);
}

/// A robot without joint limits: the spring of a limit has a kink.
fn smooth(robot: &str) -> Arc<System> {
    let mut system = (*built_in(robot)).clone();
    system.robot.joints_mut().for_each(|j| j.limit = None);
    Arc::new(system)
}

#[test]
fn methods_without_contact_have_their_textbooks_orders() {
    for robot in ["pendulum", "cartpole", "cube", "franka", "ant", "anymal"] {
        let system = smooth(robot);
        converges(&system, [16, 32, 64, 128], 0.8..1.3, 1e-2, |n| articulated(Integrator::SymplecticEuler, n));
        // A cube's inertia is isotropic: already at one substep its flight is exact to rounding.
        if robot != "cube" {
            converges(&system, [1, 2, 4, 8], 3.7..4.5, 1e-7, |n| articulated(Integrator::Rk4, n));
        }
    }
}

#[cfg(feature = "rapier")]
#[test]
fn rapier_has_order_1() {
    for robot in ["pendulum", "cartpole"] {
        let substeps = |n| Rapier::new(RapierConfig { iterations: n, steps: 1, ..Default::default() });
        converges(&built_in(robot), [16, 32, 64, 128], 0.8..1.3, 1e-2, substeps);
    }
}

/// Landing, slip and rest: the implicit step converges to the motion of explicit substeps, with fewer substeps. Contact
/// is not smooth, so the order over 2 to 32 substeps lies between 1 (the kinks) and 2 (the step).
#[test]
fn the_implicit_contact_step_converges_to_the_explicit_ones_motion() {
    // Huber friction is the same drag in both. Coulomb friction sticks in the implicit step but creeps in explicit
    // substeps, even under the largest drag that is stable there. A tumbling Ant would amplify the creep, hence Huber
    // friction.
    let cases = [
        ("pendulum", "ground1", 60, Friction::Coulomb, Some(1e5), 8192),
        ("cube", "ground", 30, Friction::Coulomb, Some(1e5), 8192),
        ("pendulum", "ground1", 60, Friction::Huber, None, 2048),
        ("ant", "ground", 60, Friction::Huber, None, 2048),
    ];
    for (robot, scene, frames, friction, drag, finest) in cases {
        let system = built_in(robot);
        let mut begun = batch(&system, scene, STARTS);
        (0..STARTS).for_each(|env| begun.reset(env, &start(&system, Start::Reset, &mut stream(500, env as u64))));
        let mut stiff = begun.clone();
        if let Some(drag) = drag {
            Arc::make_mut(&mut stiff.system).spec.material.friction_damping = drag;
            let colliders = stiff.scenes.iter_mut().flat_map(|scene| &mut Arc::make_mut(scene).colliders);
            colliders.for_each(|collider| collider.material.friction_damping = drag);
        }
        let landed = |config, batch: &Batch| end(&mut Articulated::new(config), batch.clone(), 0.0, frames);
        let exact = landed(ArticulatedConfig::explicit(finest, friction), &stiff);
        let (d, nq) = (system.robot.state_dim(), system.robot.nq());
        let error = |config| {
            let states = landed(config, &begun);
            let gaps = (0..states.len()).filter(|i| i % d < nq).map(|i| (states[i] - exact[i]).abs());
            gaps.sum::<f64>() / (STARTS * nq) as f64
        };
        let errors = [2, 8, 32, 128].map(|n| error(ArticulatedConfig::implicit(n, friction)));
        let explicit = error(ArticulatedConfig::explicit(32, friction));
        let slope = (errors[0] / errors[2]).log(16.0);
        assert!(errors[3] < 4e-4, "{robot}: {:.1e} at 128 substeps", errors[3]);
        assert!((1.2..2.2).contains(&slope), "{robot}: order {slope:.2}");
        assert!(
            errors[1] < explicit,
            "{robot}: implicit with 8 substeps {:.1e}, explicit with 32 {explicit:.1e}",
            errors[1]
        );
    }
}
