//! Which camera of a recording fills which slot of the policy's prefix, as LeRobot's `prepare_images`.

use zk0_lerobot::policy_folder::IMAGES;

use crate::error::{PolicyError, Result};

/// The prefix's cameras in order, each as an index into `found` (names of the cameras of a recording or a batch), or `None`
/// for a blank one.
///
/// Cameras that the policy knows by name come first, in the policy's order `names`. Then come blank ones for those that are
/// missing, `empty_cameras` at most. A policy without names, and a recording none of whose cameras the policy knows, go by the
/// order of the recording's names. The common start `observation.images.` may be left out.
///
/// # Errors
/// [`PolicyError::Sample`] when no camera is found, more than there are slots, or one that the policy does not know beside
/// others that it does.
pub fn camera_slots(
    names: &[String],
    slots: usize,
    empty_cameras: usize,
    found: &[&str],
) -> Result<Vec<Option<usize>>> {
    if found.is_empty() || found.len() > slots {
        return Err(PolicyError::Sample(format!(
            "the recording has {} cameras, the policy takes 1 to {slots}",
            found.len()
        )));
    }
    let short = |name: &str| name.strip_prefix(IMAGES).unwrap_or(name).to_string();
    let known = |name: &str| names.iter().position(|n| short(n) == short(name));
    let mut order: Vec<usize> = (0..found.len()).collect();
    if let Some(stranger) = found.iter().find(|name| known(name).is_none()) {
        if let Some(friend) = found.iter().find(|name| known(name).is_some()) {
            return Err(PolicyError::Sample(format!(
                "the policy has a camera `{friend}` but none called `{stranger}`; it has {}",
                names.join(", ")
            )));
        }
        order.sort_by_key(|i| found[*i]);
    } else {
        order.sort_by_key(|i| known(found[*i]));
    }
    let blank = empty_cameras.min(slots - found.len());
    Ok(order
        .into_iter()
        .map(Some)
        .chain(std::iter::repeat_n(None, blank))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|n| n.to_string()).collect()
    }

    #[test]
    fn the_policys_order_counts_then_blank_cameras_follow() {
        let policy = names(&[
            "observation.images.wrist",
            "observation.images.top",
            "observation.images.empty_camera_0",
        ]);
        let found = ["observation.images.top", "observation.images.wrist"];
        let slots = camera_slots(&policy, 3, 1, &found).unwrap();
        assert_eq!(slots, [Some(1), Some(0), None]);
        assert_eq!(
            camera_slots(&policy, 3, 0, &["top", "wrist"]).unwrap(),
            [Some(1), Some(0)]
        );
        // Two cameras are missing, and one of them may be blank.
        assert_eq!(
            camera_slots(&policy, 3, 1, &["top"]).unwrap(),
            [Some(0), None]
        );
    }

    #[test]
    fn without_known_names_the_recordings_names_are_sorted() {
        let found = ["up", "side"];
        assert_eq!(camera_slots(&[], 2, 0, &found).unwrap(), [Some(1), Some(0)]);
        let policy = names(&["observation.images.camera1", "observation.images.camera2"]);
        assert_eq!(
            camera_slots(&policy, 2, 0, &found).unwrap(),
            [Some(1), Some(0)]
        );
    }

    #[test]
    fn none_too_many_and_strangers_are_refused() {
        let policy = names(&["observation.images.top", "observation.images.wrist"]);
        for found in [&[][..], &["a", "b", "c"], &["top", "side"]] {
            let error = camera_slots(&policy, 2, 0, found).unwrap_err();
            assert!(matches!(error, PolicyError::Sample(_)), "{error}");
        }
    }
}
