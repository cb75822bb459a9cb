//! A recording's cameras for the policy's slots, as in LeRobot's `prepare_images`.

use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::policy_folder::IMAGES;

use crate::error::{PolicyError, Result};

/// The prefix's cameras in order: indices into `found` (a recording's or batch's camera names), or `None` for a blank one.
///
/// The policy's `rename_map` renames cameras. They come in the policy's order, without those that it lacks; up to `empty_cameras` blank
/// ones stand for missing ones. As in `lerobot-train`, a policy without a map takes a recording with missing or extra cameras, but not with
/// both. A policy without camera names takes the recording's order. The prefix `observation.images.` is optional.
///
/// # Errors
/// [`PolicyError::Sample`]: no camera of the policy is found, two have one slot, some are missing and others extra, or there are too few
/// slots.
pub fn camera_slots(
    config: &PolicyConfig,
    empty_cameras: usize,
    found: &[&str],
) -> Result<Vec<Option<usize>>> {
    let order = if config.camera_names.is_empty() {
        by_name(config.cameras, found)?
    } else {
        by_policy(config, found)?
    };
    let blank = empty_cameras.min(config.cameras - order.len());
    let blank = std::iter::repeat_n(None, blank);
    Ok(order.into_iter().map(Some).chain(blank).collect())
}

fn by_name(slots: usize, found: &[&str]) -> Result<Vec<usize>> {
    if found.is_empty() || found.len() > slots {
        return Err(PolicyError::Sample(format!(
            "the recording has {} cameras, the policy takes 1 to {slots}",
            found.len()
        )));
    }
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by_key(|i| found[*i]);
    Ok(order)
}

fn by_policy(config: &PolicyConfig, found: &[&str]) -> Result<Vec<usize>> {
    let named: Vec<&str> = found.iter().map(|name| renamed(config, name)).collect();
    let mut order = Vec::new();
    for wanted in &config.camera_names {
        let mut same = (0..found.len()).filter(|i| short(named[*i]) == short(wanted));
        order.extend(same.next());
        if let (Some(&first), Some(second)) = (order.last(), same.next()) {
            return Err(PolicyError::Sample(format!(
                "the recording's cameras {} and {} are both `{wanted}` to the policy: change its rename_map",
                found[first], found[second]
            )));
        }
    }
    let no_map = config.rename_map.is_empty();
    let differs = order.len() < config.camera_names.len() && order.len() < found.len();
    if order.is_empty() || (no_map && differs) {
        return Err(PolicyError::Sample(format!(
            "the policy's cameras are {}, and the recording's are {}{}. Name the policy's camera for each of the recording's, as with LeRobot's \
             --rename_map: --rename-map '{{\"observation.images.RECORDING\": \"observation.images.POLICY\"}}'",
            config.camera_names.join(", "),
            found.join(", "),
            if no_map { "" } else { ", and the policy's rename_map does not lead from these to those" }
        )));
    }
    Ok(order)
}

fn renamed<'a>(config: &'a PolicyConfig, name: &'a str) -> &'a str {
    let mut pairs = config.rename_map.iter();
    let pair = pairs.find(|(old, _)| short(old) == short(name));
    pair.map_or(name, |(_, new)| new)
}

fn short(name: &str) -> &str {
    name.strip_prefix(IMAGES).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::profile::Profile;

    fn policy(names: &[&str], renames: &[(&str, &str)]) -> PolicyConfig {
        let whole = |name: &str| format!("{IMAGES}{name}");
        let renames = renames.iter().map(|(old, new)| (whole(old), whole(new)));
        PolicyConfig {
            cameras: names.len(),
            camera_names: names.iter().map(|name| whole(name)).collect(),
            rename_map: renames.collect(),
            ..Profile::Tiny.config()
        }
    }

    fn slots(config: &PolicyConfig, empty: usize, found: &[&str]) -> Vec<Option<usize>> {
        camera_slots(config, empty, found).unwrap()
    }

    fn refused(config: &PolicyConfig, found: &[&str]) -> String {
        camera_slots(config, 0, found).unwrap_err().to_string()
    }

    #[test]
    fn the_policys_order_counts_then_blank_cameras_follow() {
        let three = policy(&["wrist", "top", "empty_camera_0"], &[]);
        let found = ["observation.images.top", "observation.images.wrist"];
        assert_eq!(slots(&three, 1, &found), [Some(1), Some(0), None]);
        assert_eq!(slots(&three, 0, &["top", "wrist"]), [Some(1), Some(0)]);
        assert_eq!(slots(&three, 1, &["top"]), [Some(0), None]);
    }

    #[test]
    fn cameras_that_the_policy_does_not_take_are_left_out() {
        let one = policy(&["wrist"], &[]);
        assert_eq!(slots(&one, 0, &["side", "wrist", "top"]), [Some(1)]);
    }

    #[test]
    fn a_map_renames_all_at_once_and_may_leave_cameras_out() {
        let crossed = [("wrist", "camera1"), ("top", "camera2")];
        let crossed = policy(&["camera1", "camera2"], &crossed);
        assert_eq!(slots(&crossed, 0, &["top", "wrist"]), [Some(1), Some(0)]);
        let swapped = policy(&["top", "wrist"], &[("top", "wrist"), ("wrist", "top")]);
        assert_eq!(slots(&swapped, 0, &["top", "wrist"]), [Some(1), Some(0)]);
        let one = policy(&["camera1", "camera2"], &[("wrist", "camera2")]);
        assert_eq!(slots(&one, 0, &["top", "wrist"]), [Some(1)]);
        assert_eq!(slots(&one, 0, &["camera2", "camera1"]), [Some(1), Some(0)]);
        let reported = refused(&one, &["camera2", "wrist"]);
        assert!(
            reported.contains("camera2 and wrist are both"),
            "{reported}"
        );
        let reported = refused(&one, &["top", "side"]);
        assert!(reported.contains("does not lead from these"), "{reported}");
    }

    #[test]
    fn other_names_without_a_map_are_refused_with_the_option_for_it() {
        let two = policy(&["top", "wrist"], &[]);
        for found in [&["up", "side"][..], &["top", "side"], &[]] {
            let reported = refused(&two, found);
            assert!(reported.contains("--rename_map"), "{reported}");
            assert!(reported.contains(&found.join(", ")), "{reported}");
        }
    }

    #[test]
    fn a_policy_without_names_goes_by_the_recordings() {
        let mut nameless = policy(&["a", "b"], &[]);
        nameless.camera_names.clear();
        assert_eq!(slots(&nameless, 0, &["up", "side"]), [Some(1), Some(0)]);
        for found in [&[][..], &["a", "b", "c"]] {
            assert!(refused(&nameless, found).contains("takes 1 to 2"));
        }
    }
}
