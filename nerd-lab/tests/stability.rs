//! Every row of the stability suite can go red, and what the presets are for.

use std::sync::Arc;

use nerd_core::state::{quaternion, vector};
use nerd_lab::experiments::stability::{accurate, converged, paper};
use nerd_sim::prelude::*;
use nerd_sim::suite::{Method, Suite, Verdict};
use rayon::prelude::*;
use strum::{EnumIter, IntoEnumIterator};

/// At a runner's speed the reference's preset gives energy for nothing and does not keep momentum. What models are learned from
/// gives no energy and keeps momentum.
#[test]
fn only_the_reference_preset_pays_a_runner() {
    let suite = Suite::new().only(&["runner's"]).expect("rows");
    let lines = suite.run(&[paper(), accurate(), converged()], |_| ());
    assert_eq!(lines.len(), 2, "{lines:?}");
    for line in &lines {
        let verdicts: Vec<_> = line.cells.iter().map(|c| c.verdict).collect();
        assert_eq!(verdicts, [Verdict::Fail, Verdict::Pass, Verdict::Pass], "{}: {:?}, limit {}", line.row, line.cells, line.limit);
    }
}

/// What is broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, EnumIter)]
enum Fault {
    /// Gravity at half its strength.
    HalfGravity,
    /// The scene's colliders are gone.
    NoFloor,
    /// Velocities are zero after every frame.
    DroppedVelocity,
    /// The root's angular velocity is given in body axes instead of world axes.
    BodyAngularVelocity,
    /// The state never changes.
    FrozenWorld,
    /// Velocities grow by 2 % a frame.
    PumpedVelocity,
    /// Velocities gain 1e-9 for every frame since the solver was made.
    HiddenClock,
    /// States are kept in f32.
    SinglePrecision,
    /// An error of the solver is passed over.
    SwallowedErrors,
    /// Motors give a tenth more than commanded.
    StrongMotors,
}

use Fault::*;

impl Fault {
    /// A method with the fault.
    fn of(self, method: Method) -> Method {
        method.around(move |solver| {
            Box::new(Broken { solver, fault: self, frame: 0, before: Vec::new(), scenes: Vec::new(), torques: Vec::new() })
        })
    }

    fn scene(self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        match self {
            HalfGravity => scene.gravity *= 0.5,
            NoFloor => scene.colliders.clear(),
            _ => {}
        }
        scene
    }
}

struct Broken {
    solver: Box<dyn Solver>,
    fault: Fault,
    frame: u64,
    before: Vec<f64>,
    /// Scenes met, and what the fault makes of them.
    scenes: Vec<[Arc<Scene>; 2]>,
    torques: Vec<f64>,
}

impl Broken {
    fn shown(&mut self, scenes: &[Arc<Scene>]) -> Vec<Arc<Scene>> {
        let one = |scene: &Arc<Scene>| {
            if let Some([_, broken]) = self.scenes.iter().find(|[known, _]| Arc::ptr_eq(known, scene)) {
                return broken.clone();
            }
            let broken = Arc::new(self.fault.scene(scene));
            self.scenes.push([scene.clone(), broken.clone()]);
            broken
        };
        scenes.iter().map(one).collect()
    }
}

impl Solver for Broken {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.before.clone_from(&batch.states);
        self.frame += 1;
        let shown = self.shown(&batch.scenes);
        let scenes = std::mem::replace(&mut batch.scenes, shown);
        self.torques.clear();
        let strength = if self.fault == StrongMotors { 1.1 } else { 1.0 };
        self.torques.extend(torques.iter().map(|t| t * strength));
        let done = self.solver.step(batch, &self.torques);
        batch.scenes = scenes;
        if self.fault != SwallowedErrors {
            done?;
        }
        let system = batch.system.clone();
        let (d, nq, floating) = (system.robot.state_dim(), system.robot.nq(), system.robot.floating());
        for (state, before) in batch.states.chunks_exact_mut(d).zip(self.before.chunks_exact(d)) {
            match self.fault {
                DroppedVelocity => state[nq..].fill(0.0),
                PumpedVelocity => state[nq..].iter_mut().for_each(|v| *v *= 1.02),
                HiddenClock => state[nq..].iter_mut().for_each(|v| *v += 1e-9 * self.frame as f64),
                SinglePrecision => state.iter_mut().for_each(|x| *x = f64::from(*x as f32)),
                FrozenWorld => state.copy_from_slice(before),
                BodyAngularVelocity if floating => into_body_axes(state, nq),
                _ => {}
            }
        }
        Ok(())
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}

/// Turns the root's angular velocity into body axes; the velocity of its origin stays.
fn into_body_axes(state: &mut [f64], nq: usize) {
    let (p, w, v) = (vector(&state[..3]), vector(&state[nq..]), vector(&state[nq + 3..]));
    let body = quaternion(&state[3..7]).inverse() * w;
    state[nq..nq + 3].copy_from_slice(body.as_slice());
    state[nq + 3..nq + 6].copy_from_slice((v + w.cross(&p) - body.cross(&p)).as_slice());
}

/// Some fault turns each row red, and each fault some row.
#[test]
fn every_row_can_go_red() {
    let (method, suite) = (converged(), Suite::new());
    let asked: Vec<_> = suite.rows().iter().filter(|row| row.must_pass()).collect();
    let red: Vec<Vec<Fault>> = asked
        .par_iter()
        .map(|row| Fault::iter().filter(|fault| row.cell(&fault.of(method.clone())).verdict != Verdict::Pass).collect())
        .collect();
    asked.iter().zip(&red).for_each(|(row, faults)| println!("{}: {faults:?}", row.name));
    let green: Vec<_> = asked.iter().zip(&red).filter(|(_, faults)| faults.is_empty()).map(|(row, _)| row.name).collect();
    assert!(green.is_empty(), "no fault is seen by {green:?}");
    let unseen: Vec<_> = Fault::iter().filter(|fault| red.iter().all(|faults| !faults.contains(fault))).collect();
    assert!(unseen.is_empty(), "no row sees {unseen:?}");
}
