//! Meshes and images that were read, so that a scene that is parsed again reads only what changed on disk.

use super::mesh::{MeshFile, read_mesh};
use super::texture::Image;
use crate::error::Result;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// Files by path, and images also by whether they hold data.
#[derive(Debug, Default)]
pub struct Assets {
    meshes: BTreeMap<PathBuf, Kept<MeshFile>>,
    images: BTreeMap<(PathBuf, bool), Kept<Image>>,
}

/// A file that was read.
#[derive(Debug)]
struct Kept<T> {
    value: Arc<T>,
    /// When it was changed, and its size.
    stamp: Option<(SystemTime, u64)>,
    /// Whether the last scene named it.
    used: bool,
}

impl Assets {
    /// The mesh file at `path`.
    pub fn mesh(&mut self, path: &Path) -> Result<Arc<MeshFile>> {
        fetch(&mut self.meshes, path.to_owned(), path, read_mesh)
    }

    /// The image at `path`, see [`Image::read`].
    pub fn image(&mut self, path: &Path, data: bool) -> Result<Arc<Image>> {
        fetch(&mut self.images, (path.to_owned(), data), path, |path| Image::read(path, data))
    }

    /// Lets go of what was not asked for since the last call.
    pub fn forget_unused(&mut self) {
        self.meshes.retain(|_, kept| std::mem::take(&mut kept.used));
        self.images.retain(|_, kept| std::mem::take(&mut kept.used));
    }
}

fn fetch<K: Ord, T>(entries: &mut BTreeMap<K, Kept<T>>, key: K, path: &Path, read: impl FnOnce(&Path) -> Result<T>) -> Result<Arc<T>> {
    let stamp = std::fs::metadata(path).ok().and_then(|m| Some((m.modified().ok()?, m.len())));
    if let Some(kept) = entries.get_mut(&key).filter(|kept| stamp.is_some() && kept.stamp == stamp) {
        kept.used = true;
        return Ok(kept.value.clone());
    }
    let value = Arc::new(read(path)?);
    entries.insert(key, Kept { value: value.clone(), stamp, used: true });
    Ok(value)
}
