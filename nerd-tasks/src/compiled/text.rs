//! Recorded formulas as C text, one line per node.

use std::fmt::Write;

use nerd_sim::articulated::device::{Reach, episode};

use super::Compiled;
use crate::formula::{Ends, Function, Given, Leaf, Node, Program, Tape, Traced, sweep};

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
    /// C text before, between and after the operands. The text between is empty for a function of one operand.
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

/// Link, point and axis as the arguments of a C call.
fn place(link: usize, [x, y, z]: [f64; 3], axis: usize) -> String {
    format!("{link}, {x:e}, {y:e}, {z:e}, {axis}")
}

impl Tape {
    /// The nodes as lines of C, and whether these lines use kinematics or distances.
    fn lines(&self) -> (String, bool) {
        let mut text = String::new();
        let mut asks = false;
        let list = |k: usize| self.lists.borrow()[k].iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        for (k, node) in self.nodes.borrow().iter().enumerate() {
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
                    // A task with plain code has no kernels.
                    Leaf::Plain(_) => Given::Known(f64::NAN).to_string(),
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

/// Gradient accumulators as lines of C.
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
        (0..by.len()).map(|i| self.tape.leaf(Leaf::Pushed { call, by: list, i })).collect()
    }
}

/// Appends the adjoint of the results to a tape that holds the program; returns the lines that accumulate gradients.
fn back(tape: &Tape, program: &Program, said: &[Given]) -> String {
    let seeds: Vec<_> = said.iter().enumerate().map(|(k, x)| (*x, tape.leaf(Leaf::By(k)))).collect();
    let mut ends = Written { tape, lines: String::new() };
    sweep(&program.nodes, &program.lists, &seeds, &mut ends);
    ends.lines
}

/// One formula as a C function: its name; its parameters beside the environment; its result; parameters of its
/// gradient. The last is `None` for a function that has no gradient.
struct Signature<'a>(&'a str, &'a str, &'a str, Option<&'a str>);

/// A task's formulas as C functions: `task_observe`, `task_act`, `task_reward`, `task_terminated` and, with levels,
/// `task_error`. A constant before each says whether the function uses kinematics or distances. With `gradients` also
/// `task_observe_back`, `task_act_back` and `task_reward_back`: vector-Jacobian products for upstream gradients `by`.
/// These add to the gradients with respect to the state (tangent space), to action and to torques.
fn functions(task: &Compiled, gradients: bool) -> String {
    let mut text = String::new();
    let mut function = |Signature(name, given, to, backward): Signature, program: &Program, said: &[Given]| {
        let tape = Tape { nodes: program.nodes.clone().into(), lists: program.lists.clone().into(), ..Tape::default() };
        let (lines, asks) = tape.lines();
        let _ = writeln!(text, "#define {}_ASKS {}", name.to_uppercase(), u8::from(asks));
        let _ = writeln!(text, "BIG void task_{name}(const Seen& s{given}, double* {to}) {{\n{lines}");
        said.iter().enumerate().for_each(|(k, x)| _ = writeln!(text, "    {to}[{k}] = {x};"));
        text.push_str("}\n");
        if let Some(backward) = backward.filter(|_| gradients) {
            let ends = back(&tape, program, said);
            let (begin, end) = if asks {
                ("    Wrench load[NL];\n    unload(load);\n", "    onto(s.work->tree, load, gradient);\n")
            } else {
                ("", "")
            };
            let (lines, _) = tape.lines();
            let _ = writeln!(
                text,
                "BIG void task_{name}_back(const Seen& s{given}, const double* by, double* gradient{backward}) {{"
            );
            let _ = writeln!(
                text,
                "    double by_state[NQ + NV] = {{}};\n{begin}{lines}{ends}{end}    numbers_back(s.state, by_state, gradient);\n}}"
            );
        }
    };
    function(Signature("observe", "", "out", Some("")), &task.observe, &task.observe.out);
    function(
        Signature("act", ", const double* action", "torques", Some(", double* by_action")),
        &task.act,
        &task.act.out,
    );
    let reward = Signature("reward", ", const double* torques", "out", Some(", double* by_torques"));
    function(reward, &task.reward, &task.reward.out[..1]);
    function(Signature("terminated", "", "out", None), &task.terminated, &task.terminated.out);
    // The levels of a curriculum depend on the error.
    if task.levels().is_some() {
        let error = task.error.out.first().copied().unwrap_or(Given::Known(f64::INFINITY));
        function(Signature("error", "", "out", None), &task.error, &[error]);
    }
    text
}

impl Compiled {
    /// Text of the task's GPU kernels, for batches within `reach`; with `gradients` it includes the kernels for
    /// gradients. The text also compiles as plain C++.
    ///
    /// # Errors
    /// If the task has plain code, a formula reads a quantity that does not exist, or the robot has no kernels.
    pub fn kernels(&self, reach: Reach, gradients: bool) -> Result<String, String> {
        if self.plain().is_some() {
            return Err(format!("task `{}` has plain code (nerd_tasks::Plain), so it stays on the CPU", self.name()));
        }
        self.wrong.clone().map_or(Ok(()), Err)?;
        episodes(self, reach, gradients)
    }
}

/// The episode around a solver as GPU code, for scenes and robots within `reach`: kernels `task_act` and `task_judge`.
/// With `gradients` also the adjoint kernels `task_arrive_back`, `task_acted_back`, `task_leave` and
/// `task_begin_again`. The text also compiles as plain C++, so tests need no GPU.
fn episodes(task: &Compiled, reach: Reach, gradients: bool) -> Result<String, String> {
    let about = task.about();
    let mut text = episode(task.recorded_for(), reach)?;
    let (level, levels) = task.levels().unwrap_or_default();
    let goals = [("GOALS", task.goal_dim()), ("MEMORY", task.memory()), ("LEVEL_AT", level), ("LEVELS", levels)];
    let sizes = [("SEEN", about.observation), ("ACTIONS", about.action), ("STEP_FRAMES", about.frames as usize)];
    for (name, n) in sizes.into_iter().chain(goals) {
        let _ = writeln!(text, "#define {name} {n}");
    }
    let _ = writeln!(text, "#define LENGTH {}ull", about.steps * about.frames);
    // C++ has no empty arrays.
    let ends: Vec<String> = task.goal().iter().flatten().chain(&[0.0]).map(|x| format!("{x:e}")).collect();
    let _ = writeln!(text, "TABLE double COMMAND[] = {{{}}};", ends.join(", "));
    text.push_str(include_str!("sight.cuh"));
    text.push_str(&functions(task, gradients));
    text.push_str(include_str!("task.cuh"));
    if gradients {
        text.push_str(include_str!("task_back.cuh"));
    }
    Ok(text)
}
