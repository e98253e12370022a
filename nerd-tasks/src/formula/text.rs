//! Recorded formulas as text: every node is a line of C.

use std::fmt::Write;

use nerd_sim::system::System;

use super::sweep::{Ends, sweep};
use super::tape::{Given, Leaf, Node, Tape, Traced};
use super::{Formulas, formulas::bounded, number::Function, sight::Recorded};
use crate::Task;

impl std::fmt::Display for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Known(x) if x.is_finite() => write!(f, "({x:e})"),
            Self::Known(x) if x.is_nan() => write!(f, "(0.0 / zero())"),
            Self::Known(x) => write!(f, "({:e} / zero())", x.signum()),
            Self::Node(k) => write!(f, "n{k}"),
        }
    }
}

impl Function {
    /// Text before, between and after the operands; with one operand nothing is between.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::Add => ["", " + ", ""],
            Self::Sub => ["", " - ", ""],
            Self::Mul => ["", " * ", ""],
            Self::Div => ["", " / ", ""],
            Self::Neg => ["-(", "", ")"],
            Self::Sqrt => ["sqrt(", "", ")"],
            Self::Exp => ["exp(", "", ")"],
            Self::Sin => ["sin(", "", ")"],
            Self::Cos => ["cos(", "", ")"],
            Self::Abs => ["fabs(", "", ")"],
            Self::Max => ["fmax(", ", ", ")"],
            Self::Min => ["fmin(", ", ", ")"],
            Self::Wrap => ["wrapped(", "", ")"],
            Self::Below => ["", " < ", " ? 1.0 : 0.0"],
        }
    }
}

/// Coordinates of a point of a link, as arguments.
fn place(link: usize, [x, y, z]: [f64; 3], axis: usize) -> String {
    format!("{link}, {x:e}, {y:e}, {z:e}, {axis}")
}

impl Tape {
    /// The lines, and whether they use kinematics or distances.
    fn lines(&self) -> (String, bool) {
        let (mut text, mut asks) = (String::new(), false);
        let list = |k: usize| self.lists.borrow()[k].iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        for (k, (node, _)) in self.nodes.borrow().iter().enumerate() {
            let said = match node {
                Node::Made(f, [a, b]) => match f.words() {
                    [before, "", after] => format!("{before}{a}{after}"),
                    [before, between, after] => format!("{before}{a}{between}{b}{after}"),
                },
                Node::Leaf(leaf) => match *leaf {
                    Leaf::State(k) => format!("s.state[{k}]"),
                    Leaf::Goal(k) => format!("s.goal[{k}]"),
                    Leaf::Action(k) => format!("action[{k}]"),
                    Leaf::Torque(k) => format!("torques[{k}]"),
                    Leaf::By(k) => format!("by[{k}]"),
                    Leaf::Place { link, local, axis } => format!("place(s, {})", place(link, local, axis)),
                    Leaf::Distance(point) => format!("gap(s, {point})"),
                    Leaf::Ground([x, y]) => format!("ground(s, {x:e}, {y:e})"),
                    Leaf::Controlled { call, i } => {
                        if i == 0 {
                            let list = list(call);
                            let _ = writeln!(
                                text,
                                "    const double a{call}[] = {{{list}}}; double t{call}[NJ + 1]; controlled(s.state, s.scene, a{call}, t{call});"
                            );
                        }
                        format!("t{call}[{i}]")
                    }
                    Leaf::Pushed { call, by, i } => {
                        if i == 0 {
                            let list = list(by);
                            let _ = writeln!(
                                text,
                                "    const double d{call}[] = {{{list}}}; double b{call}[NJ + 1]; \
                                 controlled_back(s.state, s.scene, a{call}, d{call}, b{call}, by_state);"
                            );
                        }
                        format!("b{call}[{i}]")
                    }
                },
            };
            asks |= matches!(node, Node::Leaf(Leaf::Place { .. } | Leaf::Distance(_)));
            let _ = writeln!(text, "    const double n{k} = {said};");
        }
        (text, asks)
    }
}

/// Destinations of gradients: lines of C.
struct Written<'a> {
    tape: &'a Tape,
    lines: String,
}

impl<'a> Ends<Traced<'a>> for Written<'a> {
    fn value(&self, node: usize) -> Traced<'a> {
        Traced::Node(self.tape, node)
    }

    fn leaf(&mut self, leaf: Leaf, by: Traced<'a>) {
        let by = by.given();
        let line = match leaf {
            Leaf::State(k) => format!("by_state[{k}] += {by};"),
            Leaf::Action(k) => format!("by_action[{k}] += {by};"),
            Leaf::Torque(k) => format!("by_torques[{k}] += {by};"),
            Leaf::Place { link, local, axis } => format!("place_back(s, {}, {by}, load);", place(link, local, axis)),
            Leaf::Distance(point) => format!("gap_back(s, {point}, {by}, load);"),
            _ => return,
        };
        let _ = writeln!(self.lines, "    {line}");
    }

    fn controlled(&mut self, call: usize, by: &[Traced<'a>]) -> Vec<Traced<'a>> {
        let list = self.tape.list(by);
        (0..by.len()).map(|i| self.tape.leaf(Leaf::Pushed { call, by: list, i }, f64::NAN)).collect()
    }
}

/// Appends the adjoint of the results to a tape; returns its last lines.
fn back(tape: &Tape, said: &[Traced]) -> String {
    let nodes: Vec<Node> = tape.nodes.borrow().iter().map(|(node, _)| *node).collect();
    let lists = tape.lists.borrow().clone();
    let seeds: Vec<_> = said.iter().enumerate().map(|(k, x)| (x.given(), tape.leaf(Leaf::By(k), f64::NAN))).collect();
    let mut ends = Written { tape, lines: String::new() };
    sweep(&nodes, &lists, &seeds, &mut ends);
    ends.lines
}

/// A task's formulas as C functions: `task_observe`, `task_act`, `task_reward`, `task_over` and, with levels, `task_miss`, each preceded by
/// a constant that says whether it uses kinematics or distances. With `slopes` also `task_observe_back`, `task_act_back` and
/// `task_reward_back`: vector-Jacobian products with upstream gradients `by`, which add to gradients with respect to the state, in its
/// tangent space, to action and to torques.
///
/// # Errors
/// If a formula refers to a number, a link or a point that does not exist.
pub fn written(task: &impl Formulas, system: &System, slopes: bool) -> Result<String, String> {
    let (about, goals, joints) = (Formulas::about(task), Task::goal_dim(task), system.robot.joint_count());
    let mut functions = String::new();
    let mut function = |name: &str, (given, to, backward): (&str, &str, Option<&str>), say: &dyn Fn(&mut Recorded) -> Vec<Given>| {
        let tape = Tape::default();
        let said = say(&mut Recorded::unknown(&tape, system, goals));
        if let Some(why) = tape.wrong.take() {
            return Err(format!("task `{}`, `{name}`: {why}", about.name));
        }
        let (lines, asks) = tape.lines();
        let _ = writeln!(functions, "#define {}_ASKS {}", name.to_uppercase(), u8::from(asks));
        let _ = writeln!(functions, "BIG void task_{name}(const Seen& s{given}, double* {to}) {{\n{lines}");
        said.iter().enumerate().for_each(|(k, x)| _ = writeln!(functions, "    {to}[{k}] = {x};"));
        functions.push_str("}\n");
        if let Some(backward) = backward.filter(|_| slopes) {
            let traced = said.iter().map(|x| match *x {
                Given::Known(x) => Traced::Number(x),
                Given::Node(k) => Traced::Node(&tape, k),
            });
            let ends = back(&tape, &traced.collect::<Vec<_>>());
            let (begin, end) =
                if asks { ("    Wrench load[NL];\n    unload(load);\n", "    onto(s.work->tree, load, slope);\n") } else { ("", "") };
            let (lines, _) = tape.lines();
            let _ = writeln!(functions, "BIG void task_{name}_back(const Seen& s{given}, const double* by, double* slope{backward}) {{");
            let _ = writeln!(
                functions,
                "    double by_state[NQ + NV] = {{}};\n{begin}{lines}{ends}{end}    numbers_back(s.state, by_state, slope);\n}}"
            );
        }
        Ok(())
    };
    let given = |numbers: &[Traced]| numbers.iter().map(|x| x.given()).collect::<Vec<_>>();
    function("observe", ("", "out", Some("")), &|sight| {
        let mut out = vec![Traced::Number(0.0); about.observation];
        task.observe(sight, &mut out);
        given(&out)
    })?;
    function("act", (", const double* action", "torques", Some(", double* by_action")), &|sight| {
        let mut torques = vec![Traced::Number(0.0); joints];
        let action: Vec<_> = (0..about.action).map(|k| sight.tape.leaf(Leaf::Action(k), f64::NAN)).collect();
        task.act(sight, &action, &mut torques);
        given(&torques)
    })?;
    function("reward", (", const double* torques", "out", Some(", double* by_torques")), &|sight| {
        let torques = bounded(task, system, (0..joints).map(|k| sight.tape.leaf(Leaf::Torque(k), f64::NAN)));
        given(&[task.reward(sight, &torques)])
    })?;
    function("over", ("", "out", None), &|sight| given(&[task.over(sight)]))?;
    // Levels depend on the error.
    if Task::levels(task).is_some() {
        function("miss", ("", "out", None), &|sight| given(&[task.miss(sight).unwrap_or(Traced::Number(f64::INFINITY))]))?;
    }
    Ok(functions)
}
