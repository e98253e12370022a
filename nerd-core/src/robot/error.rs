//! Why a URDF is refused.

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// What is wrong with it: the text, a link, a joint, or the tree that they make.
    #[error("{0}")]
    Refused(String),
    /// A robot without a joint, bolted down.
    #[error("nothing moves: no moving joint and no floating base")]
    Still,
}

impl UrdfError {
    pub(super) fn text(reason: &str) -> Self {
        Self::Refused(one_line(&format!("not a URDF: {reason}")))
    }

    pub(super) fn tree(reason: &str) -> Self {
        Self::Refused(one_line(&format!("the joints do not make one tree: {reason}")))
    }

    pub(super) fn link(link: &str, reason: impl AsRef<str>) -> Self {
        Self::Refused(one_line(&format!("link `{link}`: {}", reason.as_ref())))
    }

    pub(super) fn joint(joint: &str, reason: impl AsRef<str>) -> Self {
        Self::Refused(one_line(&format!("joint `{joint}`: {}", reason.as_ref())))
    }
}

/// The same words in one line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
