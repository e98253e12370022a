//! Why a URDF is refused.

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// Not a URDF.
    #[error("not a URDF: {0}")]
    Parse(String),
    /// A link that cannot be honoured.
    #[error("link `{link}`: {reason}")]
    Link {
        /// Its name.
        link: String,
        /// One line.
        reason: String,
    },
    /// A joint that cannot be honoured.
    #[error("joint `{joint}`: {reason}")]
    Joint {
        /// Its name.
        joint: String,
        /// One line.
        reason: String,
    },
    /// The links and joints do not make one tree.
    #[error("the joints do not make one tree: {0}")]
    Tree(String),
    /// A robot without a joint, bolted down.
    #[error("nothing moves: no moving joint and no floating base")]
    Still,
}

impl UrdfError {
    pub(super) fn link(link: &str, reason: impl AsRef<str>) -> Self {
        Self::Link { link: one_line(link), reason: one_line(reason.as_ref()) }
    }

    pub(super) fn joint(joint: &str, reason: impl AsRef<str>) -> Self {
        Self::Joint { joint: one_line(joint), reason: one_line(reason.as_ref()) }
    }
}

/// The same words in one line.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
