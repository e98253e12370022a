//! Checks of XML text before parsing.

/// Upper bound of the nesting depth of elements, with elements in comments included. roxmltree recurses over nesting.
pub(crate) fn nested(text: &str) -> usize {
    let mut deep = 0usize;
    let mut most = 0;
    for element in text.split('<').skip(1) {
        match element.as_bytes().first() {
            Some(b'/') => deep = deep.saturating_sub(1),
            Some(b'!' | b'?') | None => {}
            Some(_) if element.rfind('>').is_some_and(|end| element[..end].ends_with('/')) => most = most.max(deep + 1),
            Some(_) => deep += 1,
        }
        most = most.max(deep);
    }
    most
}
