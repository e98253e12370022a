//! Orders of convergence without contact: both solvers must converge to the same solution, each at the textbook order of its method
//! (Hairer, Norsett, Wanner, *Solving ODEs I*, II.1 and II.3): classical Runge-Kutta 4, symplectic Euler and rapier 1. A wrong term in
//! either dynamics gives an error that no substep removes, so the slope falls to 0.
//!
//! Bounds: 3.7..4.5 and 0.8..1.3, since a slope fitted over a decade of substeps includes the next order's terms. The finest setting must
//! also be within 1e-7 (RK4) and 1e-2 (first order) of the reference, RK4 at 64 substeps.

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
    // Light legs are not driven: they would spin.
    let push = if system.robot.floating() { [0.0; 2] } else { [40.0, 5.0] };
    let torques: Vec<f64> = (0..STARTS * joints).map(|i| push[usize::from(i % joints > 0)]).collect();
    (0..20).for_each(|_| solver.step(&mut batch, &torques).expect("finite"));
    batch.states
}

fn articulated(integrator: Integrator, substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig { integrator, ..ArticulatedConfig::explicit(substeps, Friction::Coulomb) })
}

/// Mean |difference| of q between two batches' states (rad or m).
fn apart(system: &System, a: &[f64], b: &[f64]) -> f64 {
    let (d, nq) = (system.robot.state_dim(), system.robot.nq());
    let root = std::iter::repeat_n(false, system.robot.root_coords());
    let wraps: Vec<bool> = root.chain(system.robot.joints().map(|j| j.wraps())).collect();
    let gap = |i: usize| if wraps[i % d] { wrap(a[i] - b[i]).abs() } else { (a[i] - b[i]).abs() };
    (0..a.len()).filter(|i| i % d < nq).map(gap).sum::<f64>() / (a.len() / d * nq) as f64
}

/// The slope of log(error) over log(substeps) must be in `order`, the last error below `bound`.
fn converges<S: Solver>(system: &Arc<System>, substeps: [usize; 4], order: std::ops::Range<f64>, bound: f64, solver: impl Fn(usize) -> S) {
    let reference = solved(system, articulated(Integrator::Rk4, 64));
    let errors = substeps.map(|n| apart(system, &solved(system, solver(n)), &reference));
    let (x, y) = (substeps.map(|n| (n as f64).ln()), errors.map(f64::ln));
    let (mx, my) = (x.iter().sum::<f64>() / 4.0, y.iter().sum::<f64>() / 4.0);
    let slope = -x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>() / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>();
    assert!(order.contains(&slope), "{}: order {slope:.2}, textbook within {order:?}, by mean |dq| {errors:?}", system.name);
    assert!(errors[3] < bound, "{}: {:.2e} rad at {} substeps, bound {bound:.0e}", system.name, errors[3], substeps[3]);
}

/// A robot without limits, whose springs have a kink.
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
        // A cube's inertia is a ball's: at one substep its flight is exact to rounding.
        if robot != "cube" {
            converges(&system, [1, 2, 4, 8], 3.7..4.5, 1e-7, |n| articulated(Integrator::Rk4, n));
        }
    }
}

#[cfg(feature = "rapier")]
#[test]
fn rapier_has_order_1() {
    for robot in ["pendulum", "cartpole"] {
        converges(&built_in(robot), [16, 32, 64, 128], 0.8..1.3, 1e-2, |n| Rapier::new(RapierConfig::substeps(n)));
    }
}

/// Landings, slip and rest: the implicit step converges to the motion of explicit substeps, much sooner. Contact is not smooth, so the
/// slope over 2 to 32 substeps lies between the first order of the kinks and the second of the step.
#[test]
fn the_implicit_contact_step_converges_to_the_explicit_ones_motion() {
    for (robot, scene) in [("pendulum", "ground1"), ("ant", "ground"), ("cube", "ground")] {
        let system = built_in(robot);
        let mut begun = batch(&system, scene, STARTS);
        (0..STARTS).for_each(|env| begun.reset(env, &start(&system, Start::Reset, &mut stream(500, env as u64))));
        let landed = |config| end(&mut Articulated::new(config), begun.clone(), 0.0, 60);
        let exact = landed(ArticulatedConfig::explicit(2048, Friction::Coulomb));
        let (d, nq) = (system.robot.state_dim(), system.robot.nq());
        let error = |config| {
            let states = landed(config);
            let gaps = (0..states.len()).filter(|i| i % d < nq).map(|i| (states[i] - exact[i]).abs());
            gaps.sum::<f64>() / (STARTS * nq) as f64
        };
        let errors = [2, 8, 32, 128].map(|n| error(ArticulatedConfig::implicit(n, Friction::Coulomb)));
        let explicit = error(ArticulatedConfig::explicit(32, Friction::Coulomb));
        let slope = (errors[0] / errors[2]).log(16.0);
        assert!(errors[3] < 4e-4, "{robot}: {:.1e} at 128 substeps", errors[3]);
        assert!((1.2..2.2).contains(&slope), "{robot}: order {slope:.2}");
        assert!(errors[1] < explicit, "{robot}: implicit with 8 substeps {:.1e}, explicit with 32 {explicit:.1e}", errors[1]);
    }
}
