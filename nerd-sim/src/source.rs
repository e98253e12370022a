//! Who says what a system is, and so where it is mended.

use crate::system::System;

/// Where a system comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A robot whose specification was made up of its numbers.
    Derived,
    /// A robot with a specification of its own.
    Told,
    /// `[cable]` ([`crate::cable`]).
    Cable,
}

impl System {
    /// Where its starts come from, and what lifts them out of the ground.
    pub(crate) fn starts_from(&self, which: &str) -> [String; 2] {
        let raise = "raise it along the up axis, or ask for less clearance";
        match (self.source, &self.spec.root) {
            (Source::Cable, _) => [format!("[cable] at and along, and of its joints' {which} boxes,"), "change at or along".into()],
            (_, Some(_)) => [format!("[root.{which}]"), raise.into()],
            (_, None) => [format!("the joints' {which} boxes"), raise.into()],
        }
    }

    /// Why it could not be stepped, with what to change where that is known.
    pub(crate) fn lost(&self, reason: String) -> String {
        match self.source {
            Source::Cable => format!("{reason} (raise [cable] damping or links, or substeps)"),
            Source::Derived | Source::Told => reason,
        }
    }
}
