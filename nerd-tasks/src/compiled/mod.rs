//! A task whose formulas are recorded for one robot, evaluated on the CPU (`evaluate.rs`), differentiated
//! (`gradients.rs`) and written as GPU kernels (`text.rs`). `examples/backwards.rs` is such a task.

mod evaluate;
mod gradients;
mod text;

use std::ops::Deref;

use nerd_sim::prelude::*;
use nerd_sim::sampling::hurry;
use rand_chacha::ChaCha8Rng;

use self::evaluate::Inputs;
use crate::formula::{Given, Leaf, Number, Program, Sight, Tape, Traced};
use crate::{Task, View, Work};

/// Largest number of times that [`fast_start`] halves the velocities.
const HALVINGS: usize = 12;

/// A task whose formulas are recorded for one robot: evaluated on the CPU, differentiated, and written as GPU kernels.
pub struct Compiled {
    task: Arc<dyn Task>,
    system: Arc<System>,
    observe: Program,
    act: Program,
    /// The reward, followed by its terms.
    reward: Program,
    terminated: Program,
    /// No result for a task without a success criterion.
    error: Program,
    /// Error text of the first formula that reads a quantity that does not exist. The results of such a formula are
    /// NaN.
    wrong: Option<String>,
}

impl Deref for Compiled {
    type Target = dyn Task;

    fn deref(&self) -> &Self::Target {
        &*self.task
    }
}

impl Compiled {
    /// Records a task's formulas for a robot.
    pub fn new(task: impl Into<Arc<dyn Task>>, system: &Arc<System>) -> Self {
        let task: Arc<dyn Task> = task.into();
        let mut wrong = None;
        let own = &*task;
        let about = own.about();
        let joints = system.robot.joint_count();
        let of = (own, &**system);
        // An entry that the task does not write stays NaN.
        let observe = recorded(of, "observe", &mut wrong, |sight| {
            let mut out = vec![Traced::Number(f64::NAN); about.observation];
            own.observe(sight, &mut out);
            out
        });
        let act = recorded(of, "act", &mut wrong, |sight| {
            let mut torques = vec![Traced::Number(0.0); joints];
            own.act(sight, &sight.action(about.action), &mut torques);
            torques
        });
        let reward = recorded(of, "reward", &mut wrong, |sight| {
            let bound = |joint: usize| {
                let tau = sight.tape.leaf(Leaf::Torque(joint));
                let most = if own.controlled() { system.torque_limit(joint) } else { f64::INFINITY };
                if most.is_finite() { tau.max((-most).into()).min(most.into()) } else { tau }
            };
            own.rewards(sight, &(0..joints).map(bound).collect::<Vec<_>>())
        });
        let terminated = recorded(of, "terminated", &mut wrong, |sight| vec![own.terminated(sight)]);
        let error = recorded(of, "error", &mut wrong, |sight| own.error(sight).into_iter().collect());
        Self { system: system.clone(), observe, act, reward, terminated, error, wrong, task }
    }

    /// The robot for which the formulas were recorded.
    pub fn recorded_for(&self) -> &Arc<System> {
        &self.system
    }

    /// Refuses a task with a size out of range, or with a formula that reads a quantity that does not exist.
    pub fn check(&self) -> Result<(), String> {
        self.about().check().map_err(|e| format!("task `{}`: {e}", self.name()))?;
        self.wrong.clone().map_or(Ok(()), Err)
    }

    /// Writes the observation: all observation_dim numbers.
    pub fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        self.observe.run(&*self.task, view, Inputs::default(), work, |k, x| out[k] = x);
    }

    /// Writes the joint torques (N m or N) for an action, clamped to [-1, 1].
    pub fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        self.act.run(&*self.task, view, Inputs { action, torques: &[] }, work, |k, x| torques[k] = x);
    }

    /// Reward at the state reached; `torques[joint]` acted in the last frame.
    pub fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64 {
        self.rewards(view, torques, work)[0]
    }

    /// The reward, followed by its terms.
    pub fn rewards(&self, view: View, torques: &[f64], work: &mut Work) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.reward.out.len());
        self.reward.run(&*self.task, view, Inputs { action: &[], torques }, work, |_, x| all.push(x));
        all
    }

    /// Error relative to the tolerance, if the task has a success criterion.
    pub fn error(&self, view: View, work: &mut Work) -> Option<f64> {
        let mut error = None;
        self.error.run(&*self.task, view, Inputs::default(), work, |_, x| error = Some(x));
        error
    }

    /// Whether this state terminates the episode.
    pub fn terminated(&self, view: View, work: &mut Work) -> bool {
        let mut terminated = false;
        self.terminated.run(&*self.task, view, Inputs::default(), work, |_, x| terminated = x != 0.0);
        terminated
    }

    /// Whether the task has gradients; a task whose formulas read numbers of plain code has none.
    pub fn has_gradients(&self) -> bool {
        ![&self.observe, &self.act, &self.reward].iter().any(|program| program.plain())
    }

    /// Vector-Jacobian product of [`Self::observe`] for `by[observation]`: adds to `gradient[2 nv]`. In this method and
    /// the next two, `by` is the upstream gradient with respect to the results. Gradients with respect to the state are
    /// in tangent space ([`nerd_core::tangent`]). Goals and the nearest surface of each contact point are held
    /// constant. Under a position law with prediction, so are the mass matrix and bias forces.
    pub fn observe_back(&self, view: View, work: &mut Work, by: &[f64], gradient: &mut [f64]) {
        self.observe.back(&*self.task, (view, Inputs::default()), work, by, (gradient, &mut []));
    }

    /// Vector-Jacobian product of [`Self::act`] for `by[joint]`: adds to `gradient[2 nv]`, and to `by_action`, which is
    /// with respect to the clamped action.
    pub fn act_back(
        &self,
        view: View,
        action: &[f64],
        work: &mut Work,
        by: &[f64],
        gradient: &mut [f64],
        by_action: &mut [f64],
    ) {
        self.act.back(&*self.task, (view, Inputs { action, torques: &[] }), work, by, (gradient, by_action));
    }

    /// Vector-Jacobian product of [`Self::reward`] for `by`: adds to `gradient[2 nv]` and to `by_torques[joint]`.
    pub fn reward_back(
        &self,
        view: View,
        torques: &[f64],
        work: &mut Work,
        by: f64,
        gradient: &mut [f64],
        by_torques: &mut [f64],
    ) {
        self.reward.back(&*self.task, (view, Inputs { action: &[], torques }), work, &[by], (gradient, by_torques));
    }
}

fn recorded(
    (task, system): (&dyn Task, &System),
    name: &str,
    wrong: &mut Option<String>,
    say: impl for<'a> Fn(&Sight<'a>) -> Vec<Traced<'a>>,
) -> Program {
    let tape = Tape::default();
    let said = say(&task.sight(&tape, system));
    match tape.wrong.take() {
        Some(why) => {
            wrong.get_or_insert(format!("task `{}`, `{name}`: {why}", task.name()));
            Program { out: vec![Given::Known(f64::NAN); said.len()], ..Program::default() }
        }
        None => Program::of(&tape, &said),
    }
}

/// A start state with velocities that only a good policy reaches ([`hurry`]), as training data for a model. Velocities
/// are halved until the task does not terminate at once. Termination must not depend on the goal, which is zero here.
pub fn fast_start(task: &Compiled, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let system = task.recorded_for();
    let mut state = task.reset(system, rng);
    hurry(system, &mut state, rng);
    let Ok(scene) = system.scene(task.scene()) else { return state };
    let goal = vec![0.0; task.goal_dim()];
    let mut work = Work::new(system);
    for _ in 0..HALVINGS {
        if !task.terminated(View { state: &state, goal: &goal, scene: &scene }, &mut work) {
            break;
        }
        state[system.robot.nq()..].iter_mut().for_each(|rate| *rate *= 0.5);
    }
    state
}
