//! A folder that is written whole or not at all.

use anyhow::{Context, Result};
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Has `write` fill a new folder, which then replaces `name` in `out`. After a failure or a kill, `name` is what it was before. A kill between
/// the two renames leaves it as `name.replaced`, which the next call puts back first.
pub fn write(out: &Path, name: &str, write: impl FnOnce(&Path) -> Result<()>) -> Result<PathBuf> {
    let folder = out.join(name);
    let aside = |suffix: &str| out.join(format!("{name}.{suffix}"));
    let (unfinished, replaced) = (aside("unfinished"), aside("replaced"));
    if replaced.exists() && !folder.exists() {
        let back = fs::rename(&replaced, &folder);
        back.with_context(|| format!("putting {} back", folder.display()))?;
    }
    // A killed process may leave these.
    remove(&unfinished)?;
    remove(&replaced)?;
    write(&unfinished)?;
    let placed = || -> io::Result<()> {
        if folder.exists() {
            fs::rename(&folder, &replaced)?;
        }
        fs::rename(&unfinished, &folder)?;
        File::open(out)?.sync_all()
    };
    placed().with_context(|| format!("writing {}", folder.display()))?;
    remove(&replaced)?;
    Ok(folder)
}

fn remove(folder: &Path) -> Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("removing {}", folder.display()))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::bail;

    #[test]
    fn a_folder_is_whole_or_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        let content = |text: &'static str| {
            move |to: &Path| {
                fs::create_dir(to)?;
                Ok(fs::write(to.join("file"), text)?)
            }
        };
        let read = || fs::read_to_string(out.join("folder/file")).unwrap();
        // A process was killed while writing.
        fs::create_dir(out.join("folder.unfinished")).unwrap();
        fs::write(out.join("folder.unfinished/file"), "half").unwrap();
        write(out, "folder", content("first")).unwrap();
        assert_eq!(read(), "first");
        let failed = write(out, "folder", |to| {
            content("second")(to)?;
            bail!("the disk is full")
        });
        assert!(failed.is_err());
        assert_eq!(read(), "first");
        // A process was killed between the two renames.
        fs::rename(out.join("folder"), out.join("folder.replaced")).unwrap();
        let failed = write(out, "folder", |_| bail!("the disk is full"));
        assert!(failed.is_err());
        assert_eq!(read(), "first");
        write(out, "folder", content("third")).unwrap();
        assert_eq!(read(), "third");
        assert_eq!(fs::read_dir(out).unwrap().count(), 1);
    }
}
