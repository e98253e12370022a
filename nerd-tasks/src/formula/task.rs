//! Every type of [`Formulas`] is a [`Task`], and a program for a GPU.

use std::fmt::Write;
use std::sync::Arc;

use nerd_sim::articulated::device::{Reach, episode};
use nerd_sim::system::{System, SystemError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{Formulas, formulas::bounded, sight::Direct, text::written};
use crate::{About, Slopes, Task, View, Work};

/// Methods that both traits share.
macro_rules! alike {
    ($($name:ident($($given:ident: $of:ty)?) -> $said:ty;)+) => { $(
        fn $name(&self, $($given: $of)?) -> $said {
            Formulas::$name(self, $($given)?)
        }
    )+ };
}

impl<F: Formulas> Task for F {
    alike! {
        about() -> About;
        system() -> Result<Arc<System>, SystemError>;
        fit(robot: Arc<System>) -> Result<Arc<System>, SystemError>;
        text() -> Option<&str>;
        place() -> bool;
        commands() -> Vec<(String, [f64; 2])>;
        memory() -> usize;
        controlled() -> bool;
        levels() -> Option<(usize, usize)>;
        terms() -> &[String];
        allowed() -> (f64, &str);
    }

    fn goal_dim(&self) -> usize {
        self.goal().len() + Formulas::memory(self)
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        out[self.goal().len()..].fill(0.0);
        out.iter_mut().zip(self.goal()).for_each(|(x, [low, high])| *x = low + (high - low) * rng.random::<f64>());
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        Formulas::observe(self, &mut Direct::new(view, work), out);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        let mut within = std::mem::take(&mut work.numbers);
        within.clear();
        within.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        Formulas::act(self, &mut Direct::new(view, work), &within, torques);
        work.numbers = within;
    }

    fn reward(&self, view: View, torques: &[f64], work: &mut Work) -> f64 {
        let torques = bounded(self, &work.system, torques.iter().copied());
        Formulas::reward(self, &mut Direct::new(view, work), &torques)
    }

    fn rewards(&self, view: View, torques: &[f64], work: &mut Work) -> Vec<f64> {
        let torques = bounded(self, &work.system, torques.iter().copied());
        Formulas::rewards(self, &mut Direct::new(view, work), &torques)
    }

    fn miss(&self, view: View, work: &mut Work) -> Option<f64> {
        Formulas::miss(self, &mut Direct::new(view, work))
    }

    fn terminated(&self, view: View, work: &mut Work) -> bool {
        self.over(&mut Direct::new(view, work)) != 0.0
    }

    fn slopes(&self) -> Option<&dyn Slopes> {
        Some(self)
    }

    fn kernels(&self, system: &System, reach: Reach, slopes: bool) -> Result<String, String> {
        program(self, system, reach, slopes)
    }
}

/// Everything around a solver in an episode, for scenes and robots of this reach: the kernels `task_act` and `task_judge`, and with
/// `slopes` the adjoint kernels `task_arrive_back` and `task_acted_back`. The text is also plain C++, so that a test runs it without a GPU.
fn program(task: &impl Formulas, system: &System, reach: Reach, slopes: bool) -> Result<String, String> {
    let (about, mut text) = (Formulas::about(task), episode(system, reach)?);
    let (level, levels) = Formulas::levels(task).unwrap_or_default();
    let goals = [("GOALS", task.goal_dim()), ("MEMORY", Formulas::memory(task)), ("LEVEL_AT", level), ("LEVELS", levels)];
    let sizes = [("SEEN", about.observation), ("ACTIONS", about.action), ("STEP_FRAMES", about.frames as usize)];
    for (name, n) in sizes.into_iter().chain(goals) {
        let _ = writeln!(text, "#define {name} {n}");
    }
    let _ = writeln!(text, "#define LENGTH {}ull", about.steps * about.frames);
    // C++ has no empty arrays.
    let ends: Vec<String> = task.goal().iter().flatten().chain(&[0.0]).map(|x| format!("{x:e}")).collect();
    let _ = writeln!(text, "TABLE double ASKED[] = {{{}}};", ends.join(", "));
    text.push_str(include_str!("sight.cuh"));
    text.push_str(&written(task, system, slopes)?);
    text.push_str(include_str!("task.cuh"));
    if slopes {
        text.push_str(include_str!("task_back.cuh"));
    }
    Ok(text)
}
