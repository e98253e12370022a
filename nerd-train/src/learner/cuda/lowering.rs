//! Lowers a program to the parts of a [`Plan`]. Folds scales into matrices, and fuses biases and positions with the
//! kernel that reads them. Refuses operations without kernels.

use super::*;

impl Plan {
    /// Lowers `program` for windows of `tokens` tokens. Refuses a program that the kernels do not cover.
    pub fn new(program: Program, tokens: usize) -> LearnResult<Self> {
        let starts = program.starts();
        let padded = program.width(Slot(0)).next_multiple_of(4);
        let mut plan = Self {
            tokens,
            parts: Vec::new(),
            starts,
            folds: Vec::new(),
            folded: 0,
            padded,
            attention: None,
            norm: 0,
            program,
        };
        // Kernels index the flat vector with 31 bits.
        if plan.parameters() > i32::MAX as usize / 4 {
            mismatch!("{} parameters are too many for the CUDA engine", plan.parameters());
        }
        for i in 0..plan.program.steps.len() {
            plan.check_slots(i)?;
            plan.add(plan.program.steps[i])?;
        }
        plan.fuse_shifts();
        if plan.independent_from() == plan.parts.len() {
            mismatch!("the CUDA engine needs a last operation in which tokens are independent");
        }
        Ok(plan)
    }

    /// Refuses step `i` if it shares a slot with other steps and the backward pass cannot handle that.
    fn check_slots(&self, i: usize) -> LearnResult {
        let steps = &self.program.steps;
        let Step { from, to, op } = self.program.steps[i];
        let linear = matches!(op, Op::Linear { .. });
        if from == Slot(0) && !linear || to == Slot(0) {
            return refuse("tokens go through a product first");
        }
        // In the backward pass, only norms and products add to the gradient of a slot; all other kernels overwrite it.
        let shares = |other: &&Step| match other.op {
            Op::Place(_) => false,
            Op::Linear { add: true, .. } => [other.from, other.to].contains(&from),
            _ => other.from == from,
        };
        if !linear && !matches!(op, Op::Norm | Op::Place(_)) && steps.iter().filter(shares).count() > 1 {
            return refuse("what several steps read, or add to, is read by norms and products alone");
        }
        // A weight gradient needs the input of the product unchanged.
        let changes =
            |later: &Step| later.to == from && matches!(later.op, Op::Linear { add: true, .. } | Op::Place(_));
        if linear && steps[i + 1..].iter().any(changes) {
            return refuse("what a later step changes is read by norms alone");
        }
        Ok(())
    }

    fn add(&mut self, step: Step) -> LearnResult {
        let Step { from, to, op } = step;
        match op {
            Op::Linear { weight, scale, bias, add } => {
                let folded = scale.map(|scale| self.fold_scale(weight, scale));
                self.parts.push(Part::Linear { from, to, weight, folded, add });
                self.parts.extend(bias.map(|bias| Part::Shift {
                    slot: to,
                    bias: Some(bias),
                    positions: None,
                    fused: false,
                }));
                return Ok(());
            }
            Op::Place(place) => {
                match self.parts.last_mut() {
                    Some(Part::Shift { slot, positions: positions @ None, .. }) if *slot == to => {
                        *positions = Some(place)
                    }
                    _ => self.parts.push(Part::Shift { slot: to, bias: None, positions: Some(place), fused: false }),
                }
                return Ok(());
            }
            Op::Norm => {
                let width = self.program.width(to);
                if !width.is_multiple_of(2) || ![0, width].contains(&self.norm) {
                    return refuse("norms have one width, an even one,");
                }
                self.norm = width;
            }
            Op::Attend { heads, band } => {
                let attention = Attention::new(self.program.width(to), heads, band, self.tokens)?;
                if self.attention.is_some_and(|one| one != attention) {
                    return refuse("attentions have one shape");
                }
                self.attention = Some(attention);
            }
            Op::Gate if !self.program.width(to).is_multiple_of(4) => {
                return refuse("a gate of a width that four divides is needed");
            }
            Op::Neighbours(_) | Op::Activate(_) | Op::Gate => {}
        }
        self.parts.push(Part::Step(step));
        Ok(())
    }

    /// Reserves memory for a matrix with its scale folded in, and returns its offset.
    fn fold_scale(&mut self, weight: Weight, scale: Weight) -> usize {
        let shape = &self.program.tensors[weight.0].shape;
        let at = self.folded;
        let rows = shape[0];
        let columns = shape[1];
        let row = |r: usize| [self.starts[weight.0] + r * columns, self.starts[scale.0] + r, at + r * columns, columns];
        self.folds.extend((0..rows).map(row).map(|entries| entries.map(|x| x as i32)));
        self.folded += rows * columns;
        at
    }

    /// Fuses shifts with the next part. A norm adds bias and positions while it reads. An activation adds a bias alone,
    /// if no other step reads the slot.
    fn fuse_shifts(&mut self) {
        for i in 1..self.parts.len() {
            let next = self.parts[i];
            let steps = &self.program.steps;
            let Part::Shift { slot, positions, fused, .. } = &mut self.parts[i - 1] else { continue };
            let bias_alone = positions.is_none() && steps.iter().filter(|step| step.from == *slot).count() == 1;
            *fused = match next {
                Part::Step(Step { from, op: Op::Norm, .. }) => from == *slot,
                Part::Step(Step { from, op: Op::Activate(_), .. }) => from == *slot && bias_alone,
                _ => false,
            };
        }
    }
}

fn refuse<T>(what: &str) -> LearnResult<T> {
    Err(LearnError::Mismatch(format!("{what} for the CUDA engine")))
}

#[cfg(test)]
mod tests {
    use nerd_model::program::Activation;
    use nerd_model::program::specimens::TOKENS;
    use nerd_model::transformer::Init;

    use super::*;

    #[test]
    fn what_has_no_kernel_is_refused() {
        let refused = |build: fn(&mut Program, Slot)| {
            let mut p = Program::new(3);
            let x = p.linear("first", p.tokens(), 42, [Init::Constant(0.0); 2]);
            build(&mut p, x);
            let y = p.predictions();
            p.linear("last", y, 2, [Init::Constant(0.0); 2]);
            Plan::new(p, TOKENS).err().map(|e| e.to_string())
        };
        let all: [fn(&mut Program, Slot); 4] = [
            // Heads of seven columns; an activation's slot with two readers; norms of two widths; a product with an
            // input that a later step changes.
            |p, x| _ = p.then(x, 14, Op::Attend { heads: 2, band: None }),
            |p, x| _ = [Activation::Gelu, Activation::Relu].map(|f| p.then(x, 42, Op::Activate(f))),
            |p, x| {
                _ = (
                    p.normed("a", "b", x, 10, Init::Constant(0.0)),
                    p.normed("c", "d", Slot(3), 8, Init::Constant(0.0)),
                )
            },
            |p, x| {
                let y = p.linear("other", x, 42, [Init::Constant(0.0); 2]);
                let z = p.then(y, 42, Op::Activate(Activation::Gelu));
                p.residual("back", z, x, Init::Constant(0.0));
            },
        ];
        for (i, build) in all.into_iter().enumerate() {
            let error = refused(build);
            assert!(error.as_ref().is_some_and(|error| !error.contains('\n')), "{i}: {error:?}");
        }
        assert_eq!(refused(|_, _| {}), None);
    }
}
