//! What recordings for one training must agree in. LeRobot's merge (`validate_all_metadata` of LeRobot 0.6.1) refuses the same differences.

use std::collections::BTreeSet;
use std::path::Path;

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::{Camera, DatasetError, Info, VectorFeature};

/// Refuses recordings that differ in frames per second, joints or cameras. The paths are for the error.
///
/// # Errors
/// [`DatasetError::Different`] names the first that differs from the first of all, and how.
pub fn refuse_different<'a>(
    recordings: impl IntoIterator<Item = (&'a Path, &'a Info)>,
) -> Result<(), DatasetError> {
    let mut recordings = recordings.into_iter();
    let Some((first, info)) = recordings.next() else {
        return Ok(());
    };
    for (path, other) in recordings {
        if let Some(cause) = difference(info, other) {
            return Err(DatasetError::Different {
                path: path.into(),
                first: first.into(),
                cause,
            });
        }
    }
    Ok(())
}

fn difference(first: &Info, other: &Info) -> Option<String> {
    if other.fps != first.fps {
        return Some(format!(
            "{} frames per second, not {}",
            other.fps, first.fps
        ));
    }
    for (name, ours, theirs) in [
        (STATE, &first.state, &other.state),
        (ACTION, &first.action, &other.action),
    ] {
        if theirs.dim != ours.dim {
            return Some(format!(
                "{} dimensions of {name}, not {}",
                theirs.dim, ours.dim
            ));
        }
        if named(ours) && named(theirs) && ours.names != theirs.names {
            return Some(format!(
                "{name} of the joints {:?}, not {:?}",
                theirs.names, ours.names
            ));
        }
    }
    let names = |cameras: &[Camera]| -> BTreeSet<String> {
        cameras.iter().map(|camera| camera.name.clone()).collect()
    };
    let (ours, theirs) = (names(&first.cameras), names(&other.cameras));
    (ours != theirs).then(|| {
        format!("the cameras {theirs:?} (--rename-map gives them other names), not {ours:?}")
    })
}

/// Older recordings do not name joints: nothing to compare.
fn named(feature: &VectorFeature) -> bool {
    !feature.names.is_empty()
}
