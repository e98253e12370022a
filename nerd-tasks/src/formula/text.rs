//! Formulas as text: every operation is a line of C.

use std::cell::{Cell, RefCell};
use std::fmt::Write;
use std::ops::{Add, Div, Mul, Neg, Sub};

use nerd_sim::system::System;

use super::{Formulas, Number, Sight};

/// The lines so far, and what they need of their caller.
#[derive(Debug, Default)]
pub struct Tape {
    lines: RefCell<String>,
    count: Cell<usize>,
    asks: Cell<bool>,
    /// What reaches too far.
    wrong: RefCell<Option<String>>,
}

impl Tape {
    /// A new line: the number that `formula` says.
    fn line(&self, formula: &str) -> Text<'_> {
        let k = self.count.replace(self.count.get() + 1);
        let _ = writeln!(self.lines.borrow_mut(), "    const double n{k} = {formula};");
        Text::Line(self, k)
    }

    /// Whether number k of so many is one of them.
    fn among(&self, what: &str, k: usize, count: usize) {
        if k >= count {
            self.wrong.borrow_mut().get_or_insert_with(|| format!("number {k} of {count} {what} is asked for"));
        }
    }

    fn say(&self, words: &str) {
        let _ = writeln!(self.lines.borrow_mut(), "    {words}");
    }
}

/// A number that is known, or that a line will say.
#[derive(Clone, Copy, Debug)]
pub enum Text<'a> {
    /// Known.
    Number(f64),
    /// Of this line.
    Line(&'a Tape, usize),
}

impl std::fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(x) if x.is_finite() => write!(f, "({x:e})"),
            Self::Number(x) if x.is_nan() => write!(f, "(0.0 / zero())"),
            Self::Number(x) => write!(f, "({:e} / zero())", x.signum()),
            Self::Line(_, k) => write!(f, "n{k}"),
        }
    }
}

impl From<f64> for Text<'_> {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl Text<'_> {
    /// Of one number.
    fn one(self, known: fn(f64) -> f64, name: &str) -> Self {
        match self {
            Self::Number(x) => Self::Number(known(x)),
            Self::Line(tape, _) => tape.line(&format!("{name}({self})")),
        }
    }

    /// Of two: known where both are.
    fn two(self, other: Self, known: fn(f64, f64) -> f64, [before, between, after]: [&str; 3]) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(known(a, b)),
            (Self::Line(tape, _), _) | (_, Self::Line(tape, _)) => tape.line(&format!("{before}{self}{between}{other}{after}")),
        }
    }
}

impl Add for Text<'_> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.two(other, |a, b| a + b, ["", " + ", ""])
    }
}

impl Sub for Text<'_> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.two(other, |a, b| a - b, ["", " - ", ""])
    }
}

impl Mul for Text<'_> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.two(other, |a, b| a * b, ["", " * ", ""])
    }
}

impl Div for Text<'_> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        self.two(other, |a, b| a / b, ["", " / ", ""])
    }
}

impl Neg for Text<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self.one(|x| -x, "-")
    }
}

impl Number for Text<'_> {
    fn sqrt(self) -> Self {
        self.one(f64::sqrt, "sqrt")
    }

    fn exp(self) -> Self {
        self.one(f64::exp, "exp")
    }

    fn abs(self) -> Self {
        self.one(f64::abs, "fabs")
    }

    fn max(self, other: Self) -> Self {
        self.two(other, f64::max, ["fmax(", ", ", ")"])
    }

    fn min(self, other: Self) -> Self {
        self.two(other, f64::min, ["fmin(", ", ", ")"])
    }

    fn wrap(self) -> Self {
        self.one(nerd_core::state::wrap, "wrapped")
    }

    fn below(self, other: Self) -> Self {
        self.two(other, |a, b| a.below(b), ["", " < ", " ? 1.0 : 0.0"])
    }
}

/// An environment written in words of `task.cuh`.
struct Traced<'a> {
    tape: &'a Tape,
    system: &'a System,
    goals: usize,
}

impl<'a> Sight<Text<'a>> for Traced<'a> {
    fn system(&self) -> &System {
        self.system
    }

    fn q(&self, k: usize) -> Text<'a> {
        self.tape.among("coordinates", k, self.system.robot.nq());
        self.tape.line(&format!("s.state[{k}]"))
    }

    fn qd(&self, k: usize) -> Text<'a> {
        self.tape.among("velocities", k, self.system.robot.nv());
        self.tape.line(&format!("s.state[NQ + {k}]"))
    }

    fn goal(&self, k: usize) -> Text<'a> {
        self.tape.among("numbers of the goal", k, self.goals);
        self.tape.line(&format!("s.goal[{k}]"))
    }

    fn place(&mut self, link: usize, [x, y, z]: [f64; 3]) -> [Text<'a>; 3] {
        self.tape.asks.set(true);
        self.tape.among("links", link, self.system.robot.links.len());
        [0, 1, 2].map(|k| self.tape.line(&format!("place(s, {link}, {x:e}, {y:e}, {z:e}, {k})")))
    }

    fn distance(&mut self, point: usize) -> Text<'a> {
        self.tape.asks.set(true);
        self.tape.among("contact points", point, self.system.robot.contact_points.len());
        self.tape.line(&format!("gap(s, {point})"))
    }

    fn controlled(&mut self, action: &[Text<'a>], torques: &mut [Text<'a>]) {
        let (k, joints) = (self.tape.count.get(), self.system.robot.joint_count());
        if action.len() != joints || torques.len() != joints {
            let text = format!("{} actions and {} torques for a controller of {joints} joints", action.len(), torques.len());
            self.tape.wrong.borrow_mut().get_or_insert(text);
        }
        let list = action.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        self.tape.say(&format!("const double a{k}[] = {{{list}}}; double t{k}[NJ + 1]; controlled(s.state, a{k}, t{k});"));
        torques.iter_mut().enumerate().for_each(|(i, tau)| *tau = self.tape.line(&format!("t{k}[{i}]")));
    }
}

/// A task's formulas as functions of C: `task_observe`, `task_act`, `task_reward` and `task_over`, each with a word before it that tells
/// whether it asks for links or distances.
///
/// # Errors
/// Where a formula speaks of a number, a link or a point that there is not.
pub fn written(task: &impl Formulas, system: &System) -> Result<String, String> {
    let (about, goals, joints) = (Formulas::about(task), task.goal().len(), system.robot.joint_count());
    let mut functions = String::new();
    let mut function = |name: &str, given: &str, say: &dyn Fn(&mut Traced)| {
        let tape = Tape::default();
        say(&mut Traced { tape: &tape, system, goals });
        if let Some(why) = tape.wrong.take() {
            return Err(format!("task `{}`, `{name}`: {why}", about.name));
        }
        let asks = u8::from(tape.asks.get());
        let _ = writeln!(functions, "#define {}_ASKS {asks}", name.to_uppercase());
        let _ = writeln!(functions, "BIG void task_{name}(const Seen& s{given}) {{\n{}}}", tape.lines.borrow());
        Ok(())
    };
    let list = |tape: &Tape, name: &str, numbers: &[Text]| {
        numbers.iter().enumerate().for_each(|(k, x)| tape.say(&format!("{name}[{k}] = {x};")));
    };
    function("observe", ", double* out", &|sight| {
        let mut out = vec![Text::Number(0.0); about.observation];
        task.observe(sight, &mut out);
        list(sight.tape, "out", &out);
    })?;
    function("act", ", const double* action, double* torques", &|sight| {
        let mut torques = vec![Text::Number(0.0); joints];
        let action: Vec<_> = (0..about.action).map(|k| sight.tape.line(&format!("action[{k}]"))).collect();
        task.act(sight, &action, &mut torques);
        list(sight.tape, "torques", &torques);
    })?;
    function("reward", ", const double* torques, double* out", &|sight| {
        let torques: Vec<_> = (0..joints).map(|k| sight.tape.line(&format!("torques[{k}]"))).collect();
        let reward = task.reward(sight, &torques);
        list(sight.tape, "out", &[reward]);
    })?;
    function("over", ", double* out", &|sight| {
        let over = task.over(sight);
        list(sight.tape, "out", &[over]);
    })?;
    Ok(functions)
}
