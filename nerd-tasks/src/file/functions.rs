//! Functions in expressions.

use nerd_sim::files::renamed::{self, Kind};
use nerd_sim::prelude::*;
use syn::{Expr, Lit, spanned::Spanned};

use super::expression::{Reader, Said, Value, each, paired, plain};
use super::words::{Of, sum};
use crate::formula::{Leaf, Number, Traced};

impl<'a> Reader<'a> {
    /// Value of the function `name` of `args`. To add a function, extend `needed`, `known`, the last match and
    /// `docs/tasks.md`.
    pub(super) fn called(&self, name: &str, args: &[&Expr]) -> Said<Value<'a>> {
        let no_place = |said: String| (proc_macro2::Span::call_site(), said);
        if name == "place" || name == "axis" {
            return self.place(name, args);
        }
        if name == "height_scan" {
            return self.height_scan(args);
        }
        if let Some(old) = renamed::renamed(Kind::Word, name) {
            self.facts.old.borrow_mut().push(old);
            return self.called(old.1, args);
        }
        let needed = match name {
            "exp" | "sin" | "cos" | "sqrt" | "abs" | "squared" | "wrap" | "sum" | "mean" | "norm" | "max_of"
            | "min_of" | "controlled" | "len" => 1,
            "max" | "min" | "dot" | "cross" => 2,
            "clamp" | "select" => 3,
            _ => {
                let known = "exp, sin, cos, sqrt, abs, squared, wrap, sum, mean, norm, max_of, min_of, len, controlled, max, min, dot, cross, clamp, \
                             select, place, axis, height_scan";
                return Err(no_place(format!("no function `{name}`: choose from {known}")));
            }
        };
        if args.len() != needed {
            return Err(no_place(format!("`{name}` takes {needed}, not {}", args.len())));
        }
        let values = args.iter().map(|e| self.expression(e)).collect::<Said<Vec<_>>>()?;
        let two = |f: fn(Traced<'a>, Traced<'a>) -> Traced<'a>| {
            paired(values[0].clone(), values[1].clone(), f).map_err(|s| (args[1].span(), s))
        };
        let first = || values[0].clone();
        let some = || match values[0].numbers[..] {
            [] => Err((args[0].span(), format!("`{name}` of no number"))),
            _ => Ok(values[0].numbers.iter().copied()),
        };
        let one = |x: Traced<'a>| plain(vec![x]);
        Ok(match name {
            "exp" => each(first(), Number::exp),
            "sin" => each(first(), Number::sin),
            "cos" => each(first(), Number::cos),
            "sqrt" => each(first(), Number::sqrt),
            "abs" => each(first(), Number::abs),
            "squared" => each(first(), Number::squared),
            "wrap" => each(first(), Number::wrap),
            "len" => one((values[0].numbers.len() as f64).into()),
            "sum" => one(sum(values[0].numbers.iter().copied())),
            "mean" => one(sum(some()?) / values[0].numbers.len() as f64),
            "norm" => one(sum(values[0].numbers.iter().map(|x| x.squared())).sqrt()),
            "max_of" => one(some()?.reduce(Number::max).unwrap_or(0.0.into())),
            "min_of" => one(some()?.reduce(Number::min).unwrap_or(0.0.into())),
            "max" => two(Number::max)?,
            "min" => two(Number::min)?,
            "dot" => one(sum(two(|a, b| a * b)?.numbers.into_iter())),
            "cross" => match (&values[0].numbers[..], &values[1].numbers[..]) {
                (a @ [_, _, _], b @ [_, _, _]) => {
                    plain((0..3).map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]).collect())
                }
                _ => return Err(no_place("`cross` takes two vectors of three numbers".into())),
            },
            "clamp" | "select" => {
                let [a, b, c] = [0, 1, 2].map(|k| values[k].clone());
                let said = |s| (args[2].span(), s);
                if name == "clamp" {
                    paired(two(Number::max)?, c, Number::min).map_err(said)?
                } else {
                    let yes = paired(a.clone(), b, |a, b| a * b).map_err(|s| (args[1].span(), s))?;
                    let no = paired(each(a, |a| Traced::from(1.0) - a), c, |a, b| a * b).map_err(said)?;
                    paired(yes, no, |a, b| a + b).map_err(said)?
                }
            }
            _ => {
                let joints = self.facts.system.robot.joint_count();
                let count = values[0].numbers.len();
                if count != joints {
                    return Err((
                        args[0].span(),
                        format!("`controlled` takes a number for each of {joints} joints, not {count}"),
                    ));
                }
                let call = self.tape.list(&values[0].numbers);
                let numbers = (0..joints).map(|i| self.tape.leaf(Leaf::Controlled { call, i })).collect();
                Value { numbers, of: Of::Joints }
            }
        })
    }

    /// `height_scan(xs, ys)`: ground heights (m) at distances (m) `xs` ahead of a free root and `ys` to its left, along
    /// its heading. The outer index is x, the inner index y.
    fn height_scan(&self, args: &[&Expr]) -> Said<Value<'a>> {
        let no_place = |said: String| (proc_macro2::Span::call_site(), said);
        if !self.facts.system.robot.floating() {
            return Err(no_place(format!(
                "`height_scan` is of a free root, and the base of `{}` is fixed",
                self.facts.system.name
            )));
        }
        let [xs, ys] = args else {
            return Err(no_place("`height_scan` takes places ahead and places to the left (m)".into()));
        };
        let list =
            |e: &Expr| known(&self.expression(e)?).ok_or_else(|| (e.span(), "known numbers are needed".to_string()));
        let (xs, ys) = (list(xs)?, list(ys)?);
        let at = xs.iter().flat_map(|x| ys.iter().map(|y| [*x, *y]));
        Ok(plain(at.map(|at| self.facts.ground(self.tape, at)).collect()))
    }

    /// `place("link")` or `place("link", [x, y, z])`: world position (m). `axis("link", [x, y, z])`: a direction of a
    /// link, in world axes.
    fn place(&self, function: &str, args: &[&Expr]) -> Said<Value<'a>> {
        let no_place = |said: String| (proc_macro2::Span::call_site(), said);
        let (name, local) = match args {
            [name] if function == "place" => (name, [0.0; 3]),
            [name, local] => {
                let local = known(&self.expression(local)?).and_then(|known| <[f64; 3]>::try_from(known).ok());
                (name, local.ok_or_else(|| (args[1].span(), "three known numbers are needed".to_string()))?)
            }
            _ => return Err(no_place(format!("`{function}` takes the name of a link and [x, y, z] in its axes"))),
        };
        let name = match name {
            Expr::Lit(lit) => match &lit.lit {
                Lit::Str(text) => Some(text.value()),
                _ => None,
            },
            _ => None,
        };
        let name =
            name.ok_or_else(|| (args[0].span(), "the name of a link is needed, in quotation marks".to_string()))?;
        let Some((link, at, turn)) = self.facts.frame(&name) else {
            let robot = &self.facts.system.robot;
            let known = robot.links.iter().map(|l| l.name.as_str()).chain(robot.frames.iter().map(|f| f.name.as_str()));
            return Err((
                args[0].span(),
                format!("no link `{name}`: choose from {}", known.take(40).collect::<Vec<_>>().join(", ")),
            ));
        };
        let place = |local: Vector3<f64>| {
            let local: [f64; 3] = local.into();
            [0, 1, 2].map(|axis| self.tape.leaf(Leaf::Place { link, local, axis }))
        };
        let tip = place(at + turn * Vector3::from(local));
        if function == "place" {
            return Ok(plain(tip.to_vec()));
        }
        let from = place(at);
        Ok(plain((0..3).map(|k| tip[k] - from[k]).collect()))
    }
}

/// The numbers of a value, if all are constants.
fn known(value: &Value) -> Option<Vec<f64>> {
    value.numbers.iter().map(|x| if let Traced::Number(x) = x { Some(*x) } else { None }).collect()
}
