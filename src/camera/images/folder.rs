//! Pictures that some other program puts into a folder.

use super::PictureError;
use super::source::{PictureSource, pause};
use crate::camera::picture::{StampedPicture, read_picture};
use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::path::{Path, PathBuf};

/// A folder that is looked into again and again.
///
/// What lies there at the start is old and left alone. Files must be moved in whole, by renaming.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    known: BTreeSet<PathBuf>,
    waiting: VecDeque<PathBuf>,
}

impl Folder {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), known: pictures_in(path)?, waiting: VecDeque::new() })
    }
}

impl PictureSource for Folder {
    fn next(&mut self) -> Result<Option<StampedPicture>, PictureError> {
        if self.waiting.is_empty() {
            let there = pictures_in(&self.path)?;
            self.waiting.extend(there.difference(&self.known).cloned());
            self.known = there;
        }
        let Some(path) = self.waiting.pop_front() else {
            pause();
            return Ok(None);
        };
        read_picture(&std::fs::read(path)?).map(Some)
    }

    fn can_wait(&self) -> bool {
        true
    }
}

fn pictures_in(folder: &Path) -> io::Result<BTreeSet<PathBuf>> {
    let paths = std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
    let is_picture = |path: &io::Result<PathBuf>| {
        path.as_ref().map_or(true, |path| {
            path.extension().is_some_and(|ending| ending == "png" || ending == "pgm")
        })
    };
    paths.filter(is_picture).collect()
}
