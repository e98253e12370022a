//! Orders of convergence without contact: both solvers must run to the same solution, each with the order its method has
//! in the textbook (Hairer, Norsett, Wanner, *Solving ODEs I*, II.1 and II.3): classical Runge-Kutta 4, symplectic Euler
//! and rapier 1. A wrong term in either dynamics makes an error that no substep removes, so the slope falls to 0.
//!
//! Bounds: 3.7..4.5 and 0.8..1.3, since a slope fitted over a decade of substeps carries the next order's terms; the
//! finest setting must besides be within 1e-7 (RK4) and 1e-2 (first order) of the reference, RK4 at 64 substeps.

use std::sync::Arc;

use nerd_core::dynamics::{Data, totals};
use nerd_core::state::{quaternion, write_quaternion};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

const FRAMES: usize = 20;
const STARTS: usize = 16;

/// States after `FRAMES` frames under constant torques, from starts spread over a box.
fn run(system: &Arc<System>, mut solver: impl Solver) -> Vec<f64> {
    let scene = system.scene("free").expect("scene");
    let mut batch = Batch::new(system, &scene, STARTS);
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
    // Light legs are left alone: driven, they would spin.
    let push = if system.robot.floating() { [0.0; 2] } else { [40.0, 5.0] };
    let torques: Vec<f64> = (0..STARTS * joints).map(|i| push[usize::from(i % joints > 0)]).collect();
    for _ in 0..FRAMES {
        solver.step(&mut batch, &torques).expect("finite");
    }
    batch.states
}

fn articulated(integrator: Integrator, substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig { integrator, ..ArticulatedConfig::explicit(substeps, Friction::Coulomb) })
}

/// Mean |difference| of q by number of substeps, and the slope of its logarithm.
fn order(system: &Arc<System>, name: &str, substeps: &[usize], solve: impl Fn(usize) -> Vec<f64>) -> (f64, f64) {
    let reference = run(system, articulated(Integrator::Rk4, 64));
    let (d, nq) = (system.robot.state_dim(), system.robot.nq());
    let root = std::iter::repeat_n(false, system.robot.root_coords());
    let wraps: Vec<bool> = root.chain(system.robot.joints().map(|j| j.wraps())).collect();
    let error = |states: &[f64]| {
        let gap = |i: usize| {
            let gap = states[i] - reference[i];
            if wraps[i % d] { nerd_core::state::wrap(gap).abs() } else { gap.abs() }
        };
        (0..states.len()).filter(|i| i % d < nq).map(gap).sum::<f64>() / (STARTS * nq) as f64
    };
    let errors: Vec<f64> = substeps.iter().map(|&n| error(&solve(n))).collect();
    let (x, y): (Vec<f64>, Vec<f64>) = substeps.iter().zip(&errors).map(|(n, e)| ((*n as f64).ln(), e.ln())).unzip();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (mx, my) = (mean(&x), mean(&y));
    let slope = -x.iter().zip(&y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>() / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>();
    println!(
        "{} {name}: order {slope:.3}, mean |dq| {} at {substeps:?} substeps",
        system.name,
        errors.iter().map(|e| format!("{e:.2e}")).collect::<Vec<_>>().join(" ")
    );
    (slope, errors[errors.len() - 1])
}

/// A robot without limits, whose springs begin with a kink.
fn smooth(robot: &str) -> Arc<System> {
    let mut system = (*System::named(robot).expect("built in")).clone();
    system.robot.joints_mut().for_each(|j| j.limit = None);
    Arc::new(system)
}

const ROBOTS: [&str; 6] = ["pendulum", "cartpole", "cube", "franka", "ant", "anymal"];

#[test]
fn runge_kutta_has_order_4() {
    // A cube's inertia is a ball's: at one substep its flight is exact to rounding.
    for robot in ROBOTS.into_iter().filter(|r| *r != "cube") {
        let system = smooth(robot);
        let (slope, last) = order(&system, "RK4", &[1, 2, 4, 8], |n| run(&system, articulated(Integrator::Rk4, n)));
        assert!((3.7..4.5).contains(&slope), "{robot}: order {slope:.2}, textbook 4");
        assert!(last < 1e-7, "{robot}: {last:.2e} rad at 8 substeps, bound 1e-7");
    }
}

#[test]
fn symplectic_euler_has_order_1() {
    for robot in ROBOTS {
        let system = smooth(robot);
        let (slope, last) = order(&system, "Euler", &[16, 32, 64, 128], |n| run(&system, articulated(Integrator::SymplecticEuler, n)));
        assert!((0.8..1.3).contains(&slope), "{robot}: order {slope:.2}, textbook 1");
        assert!(last < 1e-2, "{robot}: {last:.2e} rad at 128 substeps, bound 1e-2");
    }
}

/// Landings, slip and rest: the implicit step comes to the motion that explicit substeps come to, and much sooner. Contact
/// is not smooth, so the slope over 2 to 32 substeps lies between the first order of the kinks and the second of the step.
#[test]
fn the_implicit_contact_step_converges_to_the_explicit_ones_motion() {
    for (robot, scene) in [("pendulum", "ground1"), ("ant", "ground"), ("cube", "ground")] {
        let system = System::named(robot).expect("built in");
        let scene = system.scene(scene).expect("scene");
        let (starts, frames) = (16, 60);
        let run = |config: ArticulatedConfig| {
            let mut batch = Batch::new(&system, &scene, starts);
            for env in 0..starts {
                batch.reset(env, &start(&system, Start::Reset, &mut stream(500, env as u64)));
            }
            let (mut solver, tau) = (Articulated::new(config), vec![0.0; starts * system.robot.joint_count()]);
            (0..frames).for_each(|_| solver.step(&mut batch, &tau).expect("finite"));
            batch.states
        };
        let (exact, d, nq) = (run(ArticulatedConfig::explicit(2048, Friction::Coulomb)), system.robot.state_dim(), system.robot.nq());
        let error = |config| {
            let states = run(config);
            let gaps = (0..states.len()).filter(|i| i % d < nq).map(|i| (states[i] - exact[i]).abs());
            gaps.sum::<f64>() / (starts * nq) as f64
        };
        let errors = [2, 8, 32, 128].map(|n| error(ArticulatedConfig::implicit(n, Friction::Coulomb)));
        let explicit = error(ArticulatedConfig::explicit(32, Friction::Coulomb));
        let slope = (errors[0] / errors[2]).log(16.0);
        println!("{robot}: implicit {errors:.6?} at 2, 8, 32, 128 substeps, order {slope:.2}; explicit {explicit:.1e} at 32");
        assert!(errors[3] < 4e-4, "{robot}: {:.1e} at 128 substeps", errors[3]);
        assert!((1.2..2.2).contains(&slope), "{robot}: order {slope:.2}");
        assert!(errors[1] < explicit, "{robot}: implicit with 8 substeps {:.1e}, explicit with 32 {explicit:.1e}", errors[1]);
    }
}

#[cfg(feature = "rapier")]
#[test]
fn rapier_has_order_1() {
    for robot in ["pendulum", "cartpole"] {
        let system = System::named(robot).expect("built in");
        let (slope, last) = order(&system, "rapier", &[16, 32, 64, 128], |n| run(&system, Rapier::new(RapierConfig::substeps(n))));
        assert!((0.8..1.3).contains(&slope), "{robot}: order {slope:.2}, first order by design");
        assert!(last < 1e-2, "{robot}: {last:.2e} rad at 128 substeps, bound 1e-2");
    }
}

/// An arm with a light roll-bend-roll wrist, like Kinova's: where the two rolls line up they turn against each other with next to
/// no inertia, so they spin.
const WRIST: &str = r#"<robot name="wrist">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.001"/></inertial></link>
<link name="roll"><inertial><origin xyz="0 0.003 -0.05"/><mass value="0.4"/><inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="9e-5"/></inertial></link>
<link name="bend"><inertial><origin xyz="0 0.003 -0.05"/><mass value="0.4"/><inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="9e-5"/></inertial></link>
<link name="hand"><inertial><origin xyz="0 0 -0.06"/><mass value="1"/><inertia ixx="8e-4" ixy="0" ixz="0" iyy="8e-4" iyz="0" izz="6e-4"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="first" type="continuous"><parent link="arm"/><child link="roll"/><origin xyz="0 0 -0.4"/><axis xyz="0 0 1"/></joint>
<joint name="second" type="continuous"><parent link="roll"/><child link="bend"/><origin xyz="0 0 -0.1"/><axis xyz="0 1 0"/></joint>
<joint name="third" type="continuous"><parent link="bend"/><child link="hand"/><origin xyz="0 0 -0.1"/><axis xyz="0 0 1"/></joint>
</robot>"#;

/// Two engines part on such a wrist at equal physics, as far as each one's own step is from converged. A wrong term in the mass
/// matrix or the bias would leave a floor that no substep removes; energy falls by the fourth power down to 1e-10 J.
#[test]
fn a_light_wrist_keeps_its_energy_to_the_fourth_power_of_the_step() {
    let system = Arc::new(System::from_text("wrist", WRIST, None).expect("valid"));
    let scene = system.scene("free").expect("scene");
    let mut data = Data::new(&system.robot);
    let mut drift = |substeps: usize| {
        let mut batch = Batch::new(&system, &scene, 1);
        batch.state_mut(0)[..4].copy_from_slice(&[1.2, 0.3, 0.05, 0.2]);
        let mut solver = articulated(Integrator::Rk4, substeps);
        let mut energy = |batch: &Batch| totals(&system.robot, batch.state(0), &mut data).energy(&scene.gravity);
        let before = energy(&batch);
        (0..60).map(|_| solver.step(&mut batch, &[0.0; 4]).map(|()| (energy(&batch) - before).abs()).expect("finite")).fold(0.0, f64::max)
    };
    let errors: Vec<f64> = [8, 16, 32, 64, 128].map(&mut drift).into();
    let slope = (errors[0] / errors[4]).log2() / 4.0;
    println!("energy error (J) at 8, 16, .. 128 substeps: {errors:?}, slope {slope:.2}");
    assert!((3.7..4.5).contains(&slope), "slope {slope:.2}: {errors:?}");
    assert!(errors[4] < 1e-9, "{:.1e} J at 128 substeps", errors[4]);
}
