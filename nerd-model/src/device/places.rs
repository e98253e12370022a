//! Places of slots in a block's shared memory, each held until the last step that reads it.

use crate::program::op::{Program, Slot, padded};

/// Arithmetic of the products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Products {
    /// In 32 bits.
    F32,
    /// On tensor cores, operands rounded to TF32: for devices of compute capability 8 and above.
    Tf32,
}

/// Place of a slot's rows.
#[derive(Clone, Copy)]
enum Home {
    /// From this number of the shared memory on.
    Shared(usize),
    /// As neighbours so many tokens apart of another slot.
    Beside(Slot, usize),
    Nowhere,
}

/// Places of a program's slots, of so many rows each.
pub(super) struct Places<'a> {
    program: &'a Program,
    rows: usize,
    products: Products,
    homes: Vec<Home>,
    /// Numbers that are taken: first, how many, by which slot.
    taken: Vec<(usize, usize, Slot)>,
    /// Numbers that are ever taken at once.
    pub(super) most: usize,
}

impl<'a> Places<'a> {
    pub(super) fn new(program: &'a Program, rows: usize, products: Products) -> Self {
        Self { program, rows, products, homes: vec![Home::Nowhere; program.widths.len()], taken: Vec::new(), most: 0 }
    }

    /// The widest slot that has a place itself.
    pub(super) fn widest(&self) -> Option<usize> {
        let kept = self.program.widths.iter().zip(&self.homes).skip(1).filter(|(_, home)| !matches!(home, Home::Beside(..)));
        kept.map(|(width, _)| *width).max()
    }

    /// Has a slot be neighbours so many tokens apart of another one.
    pub(super) fn beside(&mut self, slot: Slot, of: Slot, off: usize) {
        self.homes[slot.0] = Home::Beside(of, off);
    }

    /// The slot that is met where this one is read.
    pub(super) fn source(&self, slot: Slot) -> Slot {
        if let Home::Beside(of, _) = self.homes[slot.0] { of } else { slot }
    }

    /// Numbers from one row of a slot to the next in shared memory, so that threads which read at once read different banks.
    pub(super) fn apart(&self, width: usize) -> usize {
        match self.products {
            Products::F32 => width.next_multiple_of(4) + 4,
            Products::Tf32 => 8 * (width.div_ceil(8) | 1),
        }
    }

    /// Where a slot is read, how far its rows are apart, of how many parts a row is, and how far those are apart.
    pub(super) fn read(&self, slot: Slot) -> Option<(String, usize, usize, usize)> {
        let width = self.program.width(slot);
        match self.homes[slot.0] {
            Home::Nowhere if slot == Slot(0) => Some(("tokens".into(), padded(width), 1, 0)),
            Home::Shared(at) => Some((format!("s + {at}"), self.apart(width), 1, 0)),
            Home::Beside(of, off) => self.read(of).map(|(at, row, ..)| (at, row, 3, off)),
            Home::Nowhere => None,
        }
    }

    /// Where a slot is written: where it is, or in the first place that is free.
    pub(super) fn write(&mut self, slot: Slot) -> String {
        if let Home::Shared(at) = self.homes[slot.0] {
            return format!("s + {at}");
        }
        let (len, mut at) = (self.rows * self.apart(self.program.width(slot)), 0);
        self.taken.sort_unstable_by_key(|(first, ..)| *first);
        for (first, taken, _) in &self.taken {
            if at + len <= *first {
                break;
            }
            at = first + taken;
        }
        self.taken.push((at, len, slot));
        self.most = self.most.max(at + len);
        self.homes[slot.0] = Home::Shared(at);
        format!("s + {at}")
    }

    /// Frees what no step from `next` on reads, adds to, or reads as neighbours.
    pub(super) fn release(&mut self, next: usize) {
        let rest = &self.program.steps[next..];
        let met = |slot: Slot| rest.iter().any(|step| step.from == slot || step.to == slot);
        let beside = |home: &Home, slot: Slot| matches!(home, Home::Beside(of, _) if *of == slot);
        let homes = &self.homes;
        let open = |slot: Slot| met(slot) || homes.iter().enumerate().any(|(k, home)| beside(home, slot) && met(Slot(k)));
        self.taken.retain(|(.., slot)| open(*slot));
    }
}
