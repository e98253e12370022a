//! Expressions in Rust's syntax, evaluated over vectors. A scalar combines with every element of a vector.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, HashMap, hash_map::Entry};
use std::ops::Range;

use syn::{BinOp, Expr, ExprBinary, ExprLit, Lit, RangeLimits, UnOp, spanned::Spanned};

use nerd_sim::files::renamed::{self, Kind};

use super::words::{Facts, Of};
use crate::formula::{Leaf, Number, Tape, Traced};

/// Limits of a formula: letters, operators, numbers in a vector, recorded steps. Then the depth of nesting, without and
/// with the names of `[let]` that the formula refers to.
const LETTERS: usize = 2000;
const SIGNS: usize = 400;
const LONGEST: usize = 4096;
const MOST: usize = 200_000;
const DEEPEST: usize = 32;
const NAMED: usize = 600;

#[derive(Clone, Debug)]
pub(super) struct Value<'a> {
    pub numbers: Vec<Traced<'a>>,
    pub of: Of,
}

/// Kind of formula: `torque` can be read in a reward, and the action to be applied in `act`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Act,
    Reward,
    Other,
}

/// Reads the expressions of one formula of a file.
pub(super) struct Reader<'a> {
    pub(super) tape: &'a Tape,
    pub(super) facts: &'a Facts,
    of: Part,
    /// Definitions under `[let]`, and the position of each command in the goal.
    lets: &'a BTreeMap<String, String>,
    commands: &'a [(String, Range<usize>)],
    /// Width of an action, and position of the last action in the goal.
    actions: usize,
    memory: usize,
    /// Values of names read so far; `None` while a name is being read.
    known: RefCell<HashMap<String, Option<Value<'a>>>>,
    /// Present depth of nested expressions.
    deep: Cell<usize>,
}

pub(super) type Said<T> = Result<T, (proc_macro2::Span, String)>;

impl<'a> Reader<'a> {
    pub fn new(
        tape: &'a Tape,
        facts: &'a Facts,
        part: Part,
        lets: &'a BTreeMap<String, String>,
        commands: &'a [(String, Range<usize>)],
        actions: usize,
        memory: usize,
    ) -> Self {
        Self {
            tape,
            facts,
            of: part,
            lets,
            commands,
            actions,
            memory,
            known: RefCell::default(),
            deep: Cell::default(),
        }
    }

    /// Value of the expression at `key` in the file.
    pub fn read(&self, key: &str, text: &str) -> Result<Vec<Traced<'a>>, String> {
        Ok(self.value(key, text)?.numbers)
    }

    /// Like `Self::read`, for an expression that must give one number.
    pub fn one(&self, key: &str, text: &str) -> Result<Traced<'a>, String> {
        let numbers = self.read(key, text)?;
        match numbers[..] {
            [one] => Ok(one),
            _ => Err(format!("{key}: one number is needed, and this has {}; write sum(..) or mean(..)", numbers.len())),
        }
    }

    /// The scalar names under `[let]` read so far.
    pub fn names(&self) -> Vec<(String, Traced<'a>)> {
        let known = self.known.borrow();
        let one = |name: &String| match known.get(name)?.as_ref()?.numbers[..] {
            [one] => Some((name.clone(), one)),
            _ => None,
        };
        self.lets.keys().filter_map(one).collect()
    }

    fn value(&self, key: &str, text: &str) -> Result<Value<'a>, String> {
        let at = |span: proc_macro2::Span, said: &str| {
            // The error of a definition under [let] already states its place.
            if let Some(said) = said.strip_prefix('\0') {
                return said.into();
            }
            let line = span.start().line;
            let column = span.start().column + 1;
            let line = if line > 1 { format!("line {line}, ") } else { String::new() };
            format!("{key}, {line}column {column}: {said}")
        };
        nested(text).map_err(|said| format!("{key}: {said}"))?;
        let python = if text.contains(" if ") { "; in place of `if` write select(condition, a, b)" } else { "" };
        let read: Expr = syn::parse_str(text).map_err(|e| at(e.span(), &format!("{e}{python}")))?;
        self.expression(&read).map_err(|(span, said)| at(span, &said))
    }

    pub(super) fn expression(&self, read: &Expr) -> Said<Value<'a>> {
        if self.deep.get() == NAMED {
            return Err((
                read.span(),
                format!("names of [let] and operators go more than {NAMED} deep into each other; say it with fewer"),
            ));
        }
        self.deep.set(self.deep.get() + 1);
        let value = self.part(read);
        self.deep.set(self.deep.get() - 1);
        value
    }

    fn part(&self, read: &Expr) -> Said<Value<'a>> {
        let wrong = |said: String| Err((read.span(), said));
        let value = match read {
            Expr::Paren(inner) => self.expression(&inner.expr)?,
            Expr::Group(inner) => self.expression(&inner.expr)?,
            Expr::Lit(lit) => plain(vec![literal(lit)?.into()]),
            Expr::Unary(unary) => {
                let inner = self.expression(&unary.expr)?;
                match unary.op {
                    UnOp::Neg(_) => each(inner, |x| -x),
                    UnOp::Not(_) => each(inner, |x| Traced::from(1.0) - x),
                    _ => return wrong("`*` before a name means nothing here".into()),
                }
            }
            Expr::Binary(both) => self.binary(both)?,
            Expr::Array(list) => {
                let parts = list.elems.iter().map(|part| self.expression(part)).collect::<Said<Vec<_>>>()?;
                plain(parts.into_iter().flat_map(|part| part.numbers).collect())
            }
            Expr::Index(index) => self.indexed(self.expression(&index.expr)?, &index.index)?,
            Expr::Path(path) => match path.path.get_ident() {
                Some(name) => self.word(&name.to_string()).map_err(|said| (read.span(), said))?,
                None => return wrong("a name without `::` is needed".into()),
            },
            Expr::MethodCall(call) if call.turbofish.is_none() => {
                let args: Vec<&Expr> = std::iter::once(&*call.receiver).chain(&call.args).collect();
                self.called(&call.method.to_string(), &args).map_err(|e| placed(e, call.method.span()))?
            }
            Expr::Call(call) => match &*call.func {
                Expr::Path(path) if path.path.get_ident().is_some() => {
                    let args: Vec<&Expr> = call.args.iter().collect();
                    let name = path.path.get_ident().map(ToString::to_string).unwrap_or_default();
                    self.called(&name, &args).map_err(|e| placed(e, call.func.span()))?
                }
                _ => return wrong("the name of a function is needed".into()),
            },
            Expr::If(_) => return wrong("in place of `if` write select(condition, a, b)".into()),
            _ => return wrong("not an expression of numbers, names, operators, [..] and functions".into()),
        };
        let steps = self.tape.nodes.borrow().len();
        if value.numbers.len() > LONGEST || steps > MOST {
            return wrong(format!(
                "it has {} numbers and {steps} steps; {LONGEST} and {MOST} are borne",
                value.numbers.len()
            ));
        }
        Ok(value)
    }

    fn binary(&self, both: &ExprBinary) -> Said<Value<'a>> {
        let (a, b) = (self.expression(&both.left)?, self.expression(&both.right)?);
        let f: fn(Traced<'a>, Traced<'a>) -> Traced<'a> = match both.op {
            BinOp::Add(_) => |a, b| a + b,
            BinOp::Sub(_) => |a, b| a - b,
            BinOp::Mul(_) => |a, b| a * b,
            BinOp::Div(_) => |a, b| a / b,
            BinOp::Lt(_) => |a, b| a.below(b),
            BinOp::Gt(_) => |a, b| b.below(a),
            BinOp::Le(_) => |a, b| Traced::from(1.0) - b.below(a),
            BinOp::Ge(_) => |a, b| Traced::from(1.0) - a.below(b),
            BinOp::And(_) => Number::min,
            BinOp::Or(_) => Number::or,
            _ => return Err((both.span(), "of operators there are + - * / < > <= >= && || !".into())),
        };
        paired(a, b, f).map_err(|said| (both.right.span(), said))
    }

    fn word(&self, name: &str) -> Result<Value<'a>, String> {
        let goal = |k: usize| self.tape.leaf(Leaf::Goal(k));
        let memory =
            |ago: usize| (0..self.actions).map(|k| goal(self.memory + ago * self.actions + k)).collect::<Vec<_>>();
        let of_joints = if self.actions == self.facts.system.robot.joint_count() { Of::Joints } else { Of::Numbers };
        if let Some((_, at)) = self.commands.iter().find(|(own, _)| own == name) {
            return Ok(plain(at.clone().map(goal).collect()));
        }
        if let Some(text) = self.lets.get(name) {
            match self.known.borrow_mut().entry(name.into()) {
                Entry::Occupied(known) => {
                    return known.get().clone().ok_or_else(|| format!("`{name}` speaks of itself"));
                }
                Entry::Vacant(room) => _ = room.insert(None),
            }
            let value = self.value(&format!("let.{name}"), text).map_err(|said| format!("\0{said}"))?;
            self.known.borrow_mut().insert(name.into(), Some(value.clone()));
            return Ok(value);
        }
        match (name, self.of) {
            ("action", Part::Act) => {
                let action = (0..self.actions).map(|k| self.tape.leaf(Leaf::Action(k)));
                Ok(Value { numbers: action.collect(), of: of_joints })
            }
            ("action", _) | ("last_action", Part::Act) => Ok(Value { numbers: memory(0), of: of_joints }),
            ("last_action", _) => Ok(Value { numbers: memory(1), of: of_joints }),
            ("time", _) => Ok(plain(vec![goal(self.memory + 2 * self.actions) * self.facts.step])),
            ("torque", Part::Reward) => {
                let torques = (0..self.facts.system.robot.joint_count()).map(|k| self.tape.leaf(Leaf::Torque(k)));
                Ok(Value { numbers: torques.collect(), of: Of::Joints })
            }
            ("torque", _) => Err("`torque` is known in the reward alone".into()),
            _ => match self.facts.word(self.tape, name) {
                Some(found) => found.map(|(numbers, of)| Value { numbers, of }),
                None => {
                    if let Some(old) = renamed::renamed(Kind::Word, name) {
                        self.facts.old.borrow_mut().push(old);
                        return self.word(old.1);
                    }
                    let own = self.commands.iter().map(|c| &c.0).chain(self.lets.keys());
                    let own: Vec<_> = own.map(String::as_str).chain([Facts::WORDS]).collect();
                    Err(format!("no word `{name}`: choose from {}", own.join(", ")))
                }
            },
        }
    }

    /// Indexing by a number, a name, a range `a..b`, or a list of numbers.
    fn indexed(&self, value: Value<'a>, index: &Expr) -> Said<Value<'a>> {
        let wrong = |said: String| (index.span(), said);
        let count = value.numbers.len();
        let numbers = |e: &Expr| self.expression(e).and_then(|v| wholes(&v).map_err(|said| (e.span(), said)));
        let (at, of) = match index {
            Expr::Lit(lit) if matches!(lit.lit, Lit::Str(_)) => {
                let Lit::Str(name) = &lit.lit else { return Err(wrong("a name is needed".into())) };
                (self.facts.named(&name.value(), value.of).map_err(wrong)?, Of::Numbers)
            }
            Expr::Range(range) => {
                let end = |e: &Option<Box<Expr>>, other: usize| e.as_ref().map_or(Ok(vec![other]), |e| numbers(e));
                let (from, to) = (end(&range.start, 0)?, end(&range.end, count)?);
                let ([from], [to]) = (&from[..], &to[..]) else {
                    return Err(wrong("one number on each side of `..`".into()));
                };
                let to = to.saturating_add(usize::from(matches!(range.limits, RangeLimits::Closed(_))));
                if *from > to || to > count {
                    return Err(wrong(format!("{from}..{to} of {count} numbers")));
                }
                ((*from..to).collect(), Of::Numbers)
            }
            _ => (numbers(index)?, Of::Numbers),
        };
        let found: Option<Vec<_>> = at.iter().map(|k| value.numbers.get(*k).copied()).collect();
        let numbers = found.ok_or_else(|| {
            wrong(format!("no number {}: it has {count}, counted from 0", at.iter().max().unwrap_or(&0)))
        })?;
        Ok(Value { numbers, of })
    }
}

/// Places an error without a place in the text at the name of its function.
fn placed((span, said): (proc_macro2::Span, String), own: proc_macro2::Span) -> (proc_macro2::Span, String) {
    (if span.start().line == 0 || span.start() == proc_macro2::Span::call_site().start() { own } else { span }, said)
}

pub(super) fn plain(numbers: Vec<Traced<'_>>) -> Value<'_> {
    Value { numbers, of: Of::Numbers }
}

pub(super) fn each<'a>(value: Value<'a>, f: impl Fn(Traced<'a>) -> Traced<'a>) -> Value<'a> {
    Value { numbers: value.numbers.into_iter().map(f).collect(), of: value.of }
}

/// Combines two vectors element by element; a scalar combines with all elements.
pub(super) fn paired<'a>(
    a: Value<'a>,
    b: Value<'a>,
    f: impl Fn(Traced<'a>, Traced<'a>) -> Traced<'a>,
) -> Result<Value<'a>, String> {
    let (n, m) = (a.numbers.len(), b.numbers.len());
    if n != m && n != 1 && m != 1 {
        return Err(format!("{n} numbers with {m}: as many are needed, or one"));
    }
    let (long, of) = if n >= m { (n, a.of) } else { (m, b.of) };
    // A scalar and an empty vector give an empty vector.
    let long = if n == 0 || m == 0 { 0 } else { long };
    let at = |of: &Value<'a>, k: usize| of.numbers[if of.numbers.len() == 1 { 0 } else { k }];
    Ok(Value { numbers: (0..long).map(|k| f(at(&a, k), at(&b, k))).collect(), of })
}

/// Constant whole numbers, as indices.
fn wholes(value: &Value) -> Result<Vec<usize>, String> {
    let whole = |x: &Traced| match x {
        Traced::Number(x) if *x >= 0.0 && x.fract() == 0.0 && *x < 1e6 => Some(*x as usize),
        _ => None,
    };
    value
        .numbers
        .iter()
        .map(whole)
        .collect::<Option<_>>()
        .ok_or_else(|| "an index is a known whole number, a name, or a..b".into())
}

/// Refuses a text nested too deeply for the parser.
fn nested(text: &str) -> Result<(), String> {
    let mut depth = 0usize;
    let mut deepest = 0;
    let mut signs = 0usize;
    for c in text.chars() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            _ => (),
        }
        signs = if "-!*&".contains(c) {
            signs + 1
        } else if c.is_whitespace() {
            signs
        } else {
            0
        };
        deepest = deepest.max(depth).max(signs);
    }
    let operators = text.chars().filter(|c| "+-*/<>&|.".contains(*c)).count();
    if text.len() > LETTERS || deepest > DEEPEST || operators > SIGNS {
        return Err(format!(
            "it has {} letters and {operators} operators, nested {deepest} deep; {LETTERS}, {SIGNS} and {DEEPEST} are borne; name parts of it under [let]",
            text.len()
        ));
    }
    Ok(())
}

fn literal(read: &ExprLit) -> Said<f64> {
    let number = match &read.lit {
        Lit::Int(x) => x.suffix().is_empty().then(|| x.base10_digits().parse::<f64>().ok()).flatten(),
        Lit::Float(x) => x.suffix().is_empty().then(|| x.base10_digits().parse::<f64>().ok()).flatten(),
        _ => return Err((read.span(), "a text stands in [..] or place(..) alone".into())),
    };
    number.filter(|x| x.is_finite()).ok_or_else(|| (read.span(), "not a number".into()))
}
