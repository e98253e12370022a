//! The materials of the built-in robots hold what stands: under a force that friction can bear, a foot or a corner creeps by
//! that force over the material's drag against slip and no more, under the truth's own substeps. The reference's materials
//! (`NAME-paper`) let it go, which shows that the tests can tell.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, point_position};
use nerd_core::state::vector;
use nerd_sim::control::Controller;
use nerd_sim::prelude::*;
use nerd_sim::scene::contacts;

/// Where a robot's root is, and its touching points by number, at the end of every second. It begins on its ground, under its
/// controller, and is pushed along x by a part of gravity (m/s^2) from the first second on.
struct Stood {
    roots: Vec<Vector3<f64>>,
    points: Vec<Vec<(usize, Vector3<f64>)>>,
}

fn stand(system: &Arc<System>, aside: f64, seconds: usize) -> Stood {
    let ground = system.scene("ground").expect("a ground");
    let mut batch = Batch::new(system, &ground, 1);
    let mut state = system.default_state();
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    let points = &system.robot.contact_points;
    // Down to where its lowest point touches.
    contacts(&system.robot, &ground, &state, &mut data, &mut events);
    let down = events.iter().zip(points).map(|(e, p)| e.distance - p.radius).fold(f64::INFINITY, f64::min);
    let up = -system.gravity().normalize();
    (0..3).for_each(|k| state[k] -= down * up[k]);
    batch.reset(0, &state);
    let (mut controller, mut solver) = (Controller::new(system), Articulated::new(ArticulatedConfig::accurate(system)));
    let (still, rate) = (vec![0.0; system.robot.joint_count()], (1.0 / system.frame_time).round() as usize);
    let (mut tau, mut stood) = (still.clone(), Stood { roots: Vec::new(), points: Vec::new() });
    for frame in 1..=seconds * rate {
        controller.torques(batch.state(0), &still, &mut tau);
        solver.step(&mut batch, &tau).expect("finite");
        if frame % rate == 0 {
            contacts(&system.robot, &ground, batch.state(0), &mut data, &mut events);
            let near = events.iter().zip(points).enumerate().filter(|(_, (e, p))| e.distance < p.radius);
            stood.points.push(near.map(|(k, (_, p))| (k, point_position(&data, p.link, &p.local))).collect());
            stood.roots.push(vector(batch.state(0)));
            let mut pushed = (*ground).clone();
            pushed.gravity.x = aside;
            batch.scenes[0] = Arc::new(pushed);
        }
    }
    stood
}

impl Stood {
    /// How the points that touch at the end of both seconds have moved from one to the other.
    fn moved(&self, from: usize, to: usize) -> Vec<Vector3<f64>> {
        let was = |k: usize| self.points[from].iter().find(|(j, _)| *j == k).map(|(_, p)| *p);
        self.points[to].iter().filter_map(|(k, now)| Some(now - was(*k)?)).collect()
    }
}

fn drag(system: &System) -> f64 {
    let ground = system.scene(system.usual_scenes().into_iter().find(|s| *s != "free").expect("a ground")).expect("scene");
    ground.colliders[0].material.mean(&system.spec.material).friction_damping
}

/// ANYmal in its pose, with four times its gains: its own, 85 N m/rad, are too soft to stand on, and it falls over on feet that
/// stand still. Its legs push each foot outwards with less than 30 N.
#[test]
fn the_feet_of_a_standing_anymal_creep_by_a_millimetre_a_second() {
    let firm = |name: &str| {
        let mut system = (*System::named(name).expect("built in")).clone();
        system.spec.joints.iter_mut().for_each(|j| (j.kp, j.kd) = (4.0 * j.kp, 4.0 * j.kd));
        Arc::new(system)
    };
    let [ours, paper] = ["anymal", "anymal-paper"].map(firm);
    let (stood, slid) = (stand(&ours, 0.0, 6), stand(&paper, 0.0, 2));
    // Outwards: each to its side.
    let outwards = |moved: Vec<Vector3<f64>>| moved.iter().map(|d| d.z.abs()).fold(0.0, f64::max);
    let (creep, sunk) = (outwards(stood.moved(0, 5)) / 5.0, stood.roots[0].y - stood.roots[5].y);
    let (first, theirs) = (outwards(stood.moved(0, 1)), outwards(slid.moved(0, 1)));
    println!(
        "feet creep by {creep:.2e} m/s; in the second second by {first:.2e} m, the reference's by {theirs:.2e}; it sinks by {sunk:.1e} m"
    );
    assert_eq!(stood.moved(0, 5).len(), 4, "feet on the ground");
    assert!(creep < 30.0 / drag(&ours), "a foot creeps by {creep:.2e} m/s, under 30 N it would by {:.2e}", 30.0 / drag(&ours));
    assert!(sunk.abs() < 5e-3, "its base sinks by {sunk:.1e} m in 5 s, allowed 5 mm");
    assert!(theirs > 5.0 * first, "the reference's feet hold as well: {theirs:.2e} m, ours {first:.2e}");
}

/// The cube on a slope of nine tenths of what friction holds: the force over four corners' drag.
#[test]
fn a_cube_on_a_slope_creeps_by_what_its_corners_let_it() {
    let aside = 0.9 * 0.15 * 9.81;
    let [ours, theirs] = ["cube", "cube-paper"].map(|name| {
        let system = System::named(name).expect("built in");
        let moved = stand(&system, aside, 6).moved(2, 5);
        let creep = moved.iter().map(|d| d.x).sum::<f64>() / 3.0 / moved.len() as f64;
        let allowed = system.robot.mass() * aside / 4.0 / drag(&system);
        println!("{name}: {} corners creep by {creep:.2e} m/s, the material says {allowed:.2e}", moved.len());
        (creep, allowed)
    });
    assert!((ours.0 / ours.1 - 1.0).abs() < 0.1, "it creeps by {:.2e} m/s, the material says {:.2e}", ours.0, ours.1);
    assert!(theirs.0 > 10.0 * ours.0, "the reference's material holds as well: {:.2e} m/s", theirs.0);
}

/// No point of a built-in robot creeps by more than 1 mm/s where 30 N push it (the cube's: all that friction can bear).
#[test]
fn thirty_newtons_move_a_foot_by_a_millimetre_a_second() {
    for (name, force) in [("pendulum", 30.0), ("ant", 30.0), ("anymal", 30.0), ("cube", 1.7)] {
        let creep = force / drag(&System::named(name).expect("built in"));
        assert!(creep < 1.001e-3, "{name}: {creep:.2e} m/s under {force} N");
    }
}
