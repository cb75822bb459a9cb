//! The option that renames a recording's cameras.

use zk0_lerobot::dataset::RenameMap;

/// Which names cameras get.
#[derive(Clone, Debug, clap::Args)]
pub struct CameraNames {
    /// Call cameras of the recording as the network or the policy does, as LeRobot's --rename_map: '{"observation.images.front":
    /// "observation.images.top"}'.
    #[arg(
        long,
        value_name = "JSON",
        default_value = "{}",
        hide_default_value = true
    )]
    pub rename_map: RenameMap,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        cameras: CameraNames,
    }

    fn read(arguments: &[&str]) -> Result<RenameMap, clap::Error> {
        let line = Line::try_parse_from([&["zk0"], arguments].concat())?;
        Ok(line.cameras.rename_map)
    }

    #[test]
    fn without_a_map_nothing_is_renamed() {
        assert_eq!(read(&[]).unwrap(), RenameMap::default());
        let map = r#"{"top": "front"}"#;
        assert_eq!(read(&["--rename-map", map]).unwrap(), map.parse().unwrap());
        let refused = read(&["--rename-map", "top=front"])
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("it is no JSON object of names"),
            "{refused}"
        );
    }
}
