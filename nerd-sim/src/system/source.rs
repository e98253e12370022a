//! Where a system's description comes from, for messages that say where to fix it.

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

impl Source {
    /// Where starts come from, of a system with a `[root]` or without, and what lifts them out of the ground.
    pub(crate) fn starts(self, rooted: bool, which: &str) -> [String; 2] {
        let raise = "raise it along the up axis, or ask for less clearance";
        match (self, rooted) {
            (Self::Cable, _) => [format!("[cable] at and along, and of its joints' {which} boxes,"), "change at or along".into()],
            (_, true) => [format!("[root.{which}]"), raise.into()],
            (_, false) => [format!("the joints' {which} boxes"), raise.into()],
        }
    }

    /// Why a frame could not be stepped, with what to change where that is known.
    pub(crate) fn lost(self, reason: String) -> String {
        match self {
            Self::Cable => format!("{reason} (raise [cable] damping or links, or substeps)"),
            Self::Derived | Self::Told => reason,
        }
    }
}
