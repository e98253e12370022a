//! Textures of an MJCF. They only affect pictures, but are refused where MuJoCo's compiler refuses them.

use super::element::Element;
use super::scope::Scope;
use crate::internal::*;

/// Refuses a texture that has neither a file nor a builtin pattern with a size.
pub(super) fn check(e: &Element, scope: &Scope) -> Result<(), UrdfError> {
    let class = scope.source.classes.of(e, None)?;
    let own = |key: &str| e.text(key).or_else(|| class.names.get(&(e.tag.clone(), key.into())).map(String::as_str));
    let whole = |key: &str| own(key).and_then(|text| text.trim().parse::<i32>().ok());
    let flat = own("type") == Some("2d");
    if own("builtin").is_none_or(|pattern| pattern == "none") {
        let from =
            |(key, file): &(String, String)| key.starts_with("file") && (!flat || key == "file") && !file.is_empty();
        return if e.attributes.iter().any(from) {
            Ok(())
        } else {
            Err(e.refused("it has neither file nor builtin; write one"))
        };
    }
    let sides = if flat { &["width", "height"][..] } else { &["width"] };
    match sides.iter().find(|key| whole(key).is_none_or(|x| x <= 0)) {
        Some(key) => Err(e.refused(format!("a builtin texture needs a {key} above zero"))),
        None if whole("nchannel").is_some_and(|n| n != 3) => Err(e.refused("a builtin texture has nchannel=\"3\"")),
        None => Ok(()),
    }
}
