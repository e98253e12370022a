//! Every row of the stability suite fails under a known fault, and only preset `paper` fails the runner rows.

use nerd_lab::experiments::stability::{accurate, converged, paper};
use nerd_sim::prelude::*;
use nerd_suite::{Method, Suite, Verdict};
use rayon::prelude::*;
use strum::{EnumIter, IntoEnumIterator};

/// Ant at 8 m/s: preset `paper` creates energy and does not conserve momentum. `accurate` (the solver that models learn
/// from) and `converged` do neither.
#[test]
fn only_the_reference_preset_pays_a_runner() {
    let suite = Suite::new().only(&["runner's"]).expect("rows");
    let lines = suite.run(&[paper(), accurate(), converged()], |_| ());
    assert_eq!(lines.len(), 2, "{lines:?}");
    for line in &lines {
        let verdicts: Vec<_> = line.cells.iter().map(|c| c.verdict).collect();
        assert_eq!(
            verdicts,
            [Verdict::Fail, Verdict::Pass, Verdict::Pass],
            "{}: {:?}, limit {}",
            line.row,
            line.cells,
            line.limit
        );
    }
}

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
    /// States are rounded to f32.
    SinglePrecision,
    /// Errors of the solver are ignored.
    SwallowedErrors,
    /// Motors apply 10 % more torque than commanded.
    StrongMotors,
}

use Fault::*;

/// For each row of the suite, the faults that make it fail.
const REDDENED: [(&str, &[Fault]); 60] = [
    ("free fall", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("off-centre spin", &[DroppedVelocity, BodyAngularVelocity, FrozenWorld]),
    ("precession", &[DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("tumbling box", &[DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("gyroscopic energy", &[DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("Dzhanibekov", &[DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("Dzhanibekov, f32", &[DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("far away", &[HiddenClock, SinglePrecision]),
    ("pendulum period", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("pendulum energy", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("drive inertia", &[DroppedVelocity, FrozenWorld, PumpedVelocity, StrongMotors]),
    ("joint limit", &[DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("heavy end", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("swinging arm", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("universal joint", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("inner torques", &[HalfGravity, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("falling quadruped", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("rest", &[NoFloor]),
    ("restitution", &[NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("level rolling", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("level rolling, energy", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity, HiddenClock]),
    ("spinning box on ice", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("flat landing", &[NoFloor, DroppedVelocity, FrozenWorld]),
    ("low flight", &[DroppedVelocity, FrozenWorld, PumpedVelocity, HiddenClock, SinglePrecision]),
    ("wheel", &[NoFloor, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("wobbling coin", &[HalfGravity, NoFloor, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("leaning can", &[NoFloor, FrozenWorld]),
    ("tossed cube", &[NoFloor, PumpedVelocity]),
    ("stiff ground", &[NoFloor, PumpedVelocity]),
    ("tip into ground", &[NoFloor, PumpedVelocity]),
    ("heavy tip", &[HalfGravity, PumpedVelocity]),
    ("light tip", &[HalfGravity, PumpedVelocity]),
    ("under terrain", &[NoFloor, FrozenWorld]),
    ("stopping distance", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("friction threshold", &[NoFloor, DroppedVelocity, FrozenWorld]),
    ("sliding down", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("plate at four yaws", &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity]),
    ("cube at four yaws", &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity]),
    ("table at four yaws", &[NoFloor, DroppedVelocity, FrozenWorld, HalfGravity, PumpedVelocity]),
    ("rolling ball", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("pendulum self-convergence", &[DroppedVelocity, FrozenWorld]),
    ("Ant self-convergence", &[NoFloor, DroppedVelocity, FrozenWorld]),
    ("Markov", &[HiddenClock]),
    ("cable's sag", &[HalfGravity, FrozenWorld]),
    ("hanging chain", &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity]),
    ("falling cable", &[NoFloor, FrozenWorld, PumpedVelocity]),
    ("driven Ant", &[BodyAngularVelocity]),
    ("ANYmal kp 85", &[NoFloor, FrozenWorld]),
    ("kp 200 ahead", &[NoFloor, FrozenWorld]),
    ("kp 2000 ahead", &[NoFloor, FrozenWorld]),
    ("kp 5000 ahead", &[NoFloor, FrozenWorld]),
    ("no number", &[SwallowedErrors]),
    (
        "runner's energy",
        &[HalfGravity, NoFloor, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity, StrongMotors],
    ),
    ("runner's momentum", &[HalfGravity, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("long steps", &[HalfGravity, NoFloor, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("tosses", &[HalfGravity, NoFloor, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("fast spin", &[DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity]),
    ("clapping chain", &[FrozenWorld, PumpedVelocity]),
    ("creep", &[NoFloor, FrozenWorld]),
    ("break-away", &[HalfGravity, NoFloor, DroppedVelocity, FrozenWorld, PumpedVelocity]),
];

impl Fault {
    fn of(self, method: Method) -> Method {
        method.around(move |solver| {
            Box::new(Broken {
                solver,
                fault: self,
                frame: 0,
                before: Vec::new(),
                scenes: Vec::new(),
                torques: Vec::new(),
            })
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
    /// Each scene met, beside the scene with the fault.
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

/// Turns the root's angular velocity into body axes; the velocity of the root's origin stays.
fn into_body_axes(state: &mut [f64], nq: usize) {
    let (p, w, v) = (vector(&state[..3]), vector(&state[nq..]), vector(&state[nq + 3..]));
    let body = quaternion(&state[3..7]).inverse() * w;
    state[nq..nq + 3].copy_from_slice(body.as_slice());
    state[nq + 3..nq + 6].copy_from_slice((v + w.cross(&p) - body.cross(&p)).as_slice());
}

/// Under each fault exactly the rows fail that `REDDENED` lists with it.
#[test]
fn every_row_can_go_red() {
    let (method, suite) = (converged(), Suite::new());
    let asked =
        suite.rows().iter().filter(|row| row.must_pass()).flat_map(|row| Fault::iter().map(|fault| (*row, fault)));
    let wrong: Vec<String> = asked
        .collect::<Vec<_>>()
        .par_iter()
        .filter_map(|(row, fault)| {
            let cell = row.cell(&fault.of(method.clone()));
            let named = REDDENED.iter().any(|(name, faults)| *name == row.name && faults.contains(fault));
            ((cell.verdict != Verdict::Pass) != named)
                .then(|| format!("{} under {fault:?}: {:?}", row.name, (cell.figure, cell.lost)))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
