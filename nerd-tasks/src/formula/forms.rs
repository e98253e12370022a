//! Normal forms of recorded numbers. A form does not depend on the way the formula was written.

use std::collections::BTreeMap;

use nerd_sim::prelude::*;

use super::tape::{Given, Leaf, Node, Tape, Traced};
use super::{Number, number::Function};

/// A polynomial in atoms: the coefficient of each monomial, a sorted list of atom indices. The empty monomial has the
/// constant.
type Polynomial = BTreeMap<Vec<usize>, f64>;

/// Largest number of terms up to which a product is multiplied out.
const MOST: usize = 4096;
/// Differences of coefficients up to this share of the largest coefficient count as rounding error.
const ALIKE: f64 = 1e-12;
/// Index of the component w of a free root's quaternion in the state. In products `w^2` becomes `1 - x^2 - y^2 - z^2`.
const W: usize = 6;

/// A quantity that is not expanded further: an input, a function of polynomials, or torque i of the controller.
#[derive(Clone, Debug, PartialEq)]
enum Atom {
    Input(Leaf),
    Made(Function, [Polynomial; 2]),
    Controlled(usize, Vec<Polynomial>),
}

/// Normal forms of all numbers on a tape: polynomials in inputs and in functions of polynomials. The quaternion of a
/// free root counts as normalised. For a robot without `[control]`, the controller's torques are proportional to
/// actions.
pub struct Forms<'a> {
    system: &'a System,
    atoms: Vec<Atom>,
    nodes: Vec<Polynomial>,
}

impl<'a> Forms<'a> {
    /// Forms of all numbers on a tape.
    pub fn of(tape: &Tape, system: &'a System) -> Self {
        let mut forms = Self { system, atoms: Vec::new(), nodes: Vec::new() };
        let lists = tape.lists.borrow();
        for node in tape.nodes.borrow().iter() {
            let form = match *node {
                Node::Made(f, [a, b]) => forms.made(f, forms.get(a), forms.get(b)),
                Node::Leaf(Leaf::Controlled { call, i }) => forms.controlled(i, &lists[call]),
                Node::Leaf(leaf) => forms.atom(Atom::Input(leaf)),
            };
            forms.nodes.push(form);
        }
        forms
    }

    /// The value of `of`, if it is a constant.
    pub fn constant(&self, of: Traced) -> Option<f64> {
        constant(&self.get(of.given()))
    }

    /// Coefficients c and offset with `of = sum_k c_k by_k + offset`, if `of` is linear in `by`.
    pub fn linear(&self, of: Traced, by: &[Traced]) -> Option<(Vec<f64>, f64)> {
        let mut left = self.get(of.given());
        let most = left.values().fold(0.0, |most: f64, x| most.max(x.abs()));
        let mut scale = |by: &Traced| {
            let by = self.get(by.given());
            let last = by.iter().next_back();
            let Some((first, unit)) = last.filter(|(monomial, _)| !monomial.is_empty()) else { return 0.0 };
            let scale = left.get(first).map_or(0.0, |x| x / unit);
            by.iter().for_each(|(monomial, x)| add(&mut left, monomial.clone(), -scale * x));
            scale
        };
        let scales = by.iter().map(&mut scale).collect();
        let offset = left.remove(&vec![]).unwrap_or(0.0);
        let rest = left.values().all(|x| x.abs() <= ALIKE * most);
        (rest && most.is_finite()).then_some((scales, offset))
    }

    fn get(&self, x: Given) -> Polynomial {
        match x {
            Given::Known(x) => known(x),
            Given::Node(k) => self.nodes[k].clone(),
        }
    }

    fn index(&mut self, atom: Atom) -> usize {
        self.atoms.iter().position(|own| *own == atom).unwrap_or_else(|| {
            self.atoms.push(atom);
            self.atoms.len() - 1
        })
    }

    fn atom(&mut self, atom: Atom) -> Polynomial {
        [(vec![self.index(atom)], 1.0)].into()
    }

    fn made(&mut self, f: Function, a: Polynomial, b: Polynomial) -> Polynomial {
        match (f, constant(&a), constant(&b)) {
            (_, Some(a), Some(b)) => known(a.made(f, b)),
            (Function::Add, ..) => sum(a, &b, 1.0),
            (Function::Sub, ..) => sum(a, &b, -1.0),
            (Function::Neg, ..) => sum(Polynomial::new(), &a, -1.0),
            (Function::Mul, ..) if a.len() * b.len() <= MOST => self.product(&a, &b),
            (Function::Div, _, Some(by)) => a.into_iter().map(|(monomial, x)| (monomial, x / by)).collect(),
            (Function::Div, ..) => {
                let inverse = self.atom(Atom::Made(f, [known(1.0), b]));
                self.product(&a, &inverse)
            }
            _ => self.atom(Atom::Made(f, [a, b])),
        }
    }

    /// The product, with `w^2 = 1 - x^2 - y^2 - z^2` for the quaternion of a free root.
    fn product(&mut self, a: &Polynomial, b: &Polynomial) -> Polynomial {
        let mut all = Polynomial::new();
        for ((p, x), (q, y)) in a.iter().flat_map(|a| b.iter().map(move |b| (a, b))) {
            let mut monomial = [p.as_slice(), q].concat();
            monomial.sort_unstable();
            self.put(&mut all, monomial, x * y);
        }
        all
    }

    fn put(&mut self, all: &mut Polynomial, mut monomial: Vec<usize>, x: f64) {
        let w = |atom: &usize| self.system.robot.floating() && self.atoms[*atom] == Atom::Input(Leaf::State(W));
        match monomial.iter().position(w).filter(|at| monomial.get(at + 1) == Some(&monomial[*at])) {
            Some(at) => {
                monomial.drain(at..at + 2);
                for k in W - 3..W {
                    let atom = self.index(Atom::Input(Leaf::State(k)));
                    let mut other = [&monomial[..], &[atom; 2]].concat();
                    other.sort_unstable();
                    self.put(all, other, -x);
                }
                self.put(all, monomial, x);
            }
            None => add(all, monomial, x),
        }
    }

    fn controlled(&mut self, i: usize, action: &[Given]) -> Polynomial {
        let action: Vec<Polynomial> = action.iter().map(|a| self.get(*a)).collect();
        // An action is in [-1, 1] already, so the bounds of direct torques do not change it.
        let input = |atom: usize| matches!(self.atoms[atom], Atom::Input(Leaf::Action(_)));
        let own = |monomial: &[usize]| matches!(*monomial, [atom] if input(atom));
        let bounded = action[i].len() == 1 && action[i].iter().all(|(monomial, x)| own(monomial) && *x == 1.0);
        match self.system.joint_specs().nth(i).filter(|_| bounded && self.system.spec.control.is_none()) {
            Some(joint) => sum(Polynomial::new(), &action[i], joint.gain.unwrap_or(joint.torque)),
            None => self.atom(Atom::Controlled(i, action)),
        }
    }
}

fn known(x: f64) -> Polynomial {
    let mut all = Polynomial::new();
    add(&mut all, Vec::new(), x);
    all
}

fn constant(of: &Polynomial) -> Option<f64> {
    match of.len() {
        0 => Some(0.0),
        1 => of.get(&vec![]).copied(),
        _ => None,
    }
}

/// Adds `x` times a monomial to a polynomial; drops the term if its coefficient becomes zero.
fn add(all: &mut Polynomial, monomial: Vec<usize>, x: f64) {
    let sum = all.get(&monomial).map_or(x, |own| own + x);
    if sum == 0.0 { _ = all.remove(&monomial) } else { _ = all.insert(monomial, sum) }
}

fn sum(mut all: Polynomial, other: &Polynomial, scale: f64) -> Polynomial {
    other.iter().for_each(|(monomial, x)| add(&mut all, monomial.clone(), scale * x));
    all
}
