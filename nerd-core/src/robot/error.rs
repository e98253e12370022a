//! Why a URDF is refused.

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// Not a URDF.
    #[error("not a URDF: {0}")]
    Parse(String),
    /// A link that cannot be honoured, and why.
    #[error("link `{0}`: {1}")]
    Link(String, String),
    /// A joint that cannot be honoured, and why.
    #[error("joint `{0}`: {1}")]
    Joint(String, String),
    /// The links and joints do not make one tree.
    #[error("the joints do not make one tree: {0}")]
    Tree(String),
    /// A robot without a joint, bolted down.
    #[error("nothing moves: no moving joint and no floating base")]
    Still,
}

impl UrdfError {
    pub(super) fn link(link: &str, reason: impl AsRef<str>) -> Self {
        Self::Link(one_line(link), one_line(reason.as_ref()))
    }

    pub(super) fn joint(joint: &str, reason: impl AsRef<str>) -> Self {
        Self::Joint(one_line(joint), one_line(reason.as_ref()))
    }
}

/// The same words in one line.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
