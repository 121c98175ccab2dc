//! The scene as a TOML document that can be edited: comments and order survive, the text is what is parsed and saved.
//!
//! Keys are those of `--set`, see [`crate::scene::edit`].

use crate::error::{Error, Result};
use crate::film::write_atomically;
use crate::scene::{Assets, Scene, edit, parse_scene_with, read_scene};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use toml_edit::{ArrayOfTables, DocumentMut, Item, Value};

/// When a file was changed, and its size.
pub(super) type Stamp = Option<(SystemTime, u64)>;

/// A scene file in the making.
#[derive(Clone, Debug)]
pub struct Document {
    /// Where it was read from or saved to; the built-in scene has no file.
    path: Option<PathBuf>,
    /// The file as it was read or written.
    stamp: Stamp,
    /// Assignments of the command line, which are made again whenever the file is read, until it holds them.
    overrides: Vec<String>,
    toml: DocumentMut,
}

impl Document {
    /// Reads a scene file, or the built-in scene, and makes the assignments `key.path=value`.
    pub fn open(path: Option<&Path>, overrides: &[String]) -> Result<Document> {
        // Before it is read: what is written meanwhile is a change.
        let stamp = path.and_then(stamp_of);
        let (name, text) = read_scene(path)?;
        let mut toml: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| {
            let (line, column) = edit::line_and_column(&text, e.span().map_or(0, |s| s.start));
            Error::Scene { path: name.clone(), line, column, reason: edit::one_line(e.message()) }
        })?;
        for assignment in overrides {
            edit::assign(&mut toml, assignment)?;
        }
        Ok(Document { path: path.map(Path::to_owned), stamp, overrides: overrides.to_vec(), toml })
    }

    /// Reads its file again, with the same assignments.
    pub fn reread(&self) -> Result<Document> {
        Document::open(self.path.as_deref(), &self.overrides)
    }

    /// Its file, if it has one.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The file as it was read or written.
    pub(super) fn stamp(&self) -> Stamp {
        self.stamp
    }

    /// The file as it is now.
    pub(super) fn stamp_now(&self) -> Stamp {
        self.path().and_then(stamp_of)
    }

    /// What errors and files beside it are named after.
    pub fn name(&self) -> PathBuf {
        self.path.clone().unwrap_or_else(|| "built-in".into())
    }

    /// The text of the scene file.
    pub fn text(&self) -> String {
        self.toml.to_string()
    }

    /// The scene it describes.
    pub fn to_scene(&self, assets: &mut Assets) -> Result<Scene> {
        parse_scene_with(&self.name(), &self.text(), &[], assets)
    }

    /// What is at a key.
    pub fn get(&self, key: &str) -> Option<&Item> {
        edit::parts(key).try_fold(self.toml.as_item(), |item, part| match part.parse::<usize>() {
            Ok(index) if !item.is_table_like() => item.get(index),
            _ => item.get(part),
        })
    }

    /// The number at a key.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.get(key).and_then(number)
    }

    /// The text at a key.
    pub fn word(&self, key: &str) -> Option<&str> {
        self.get(key)?.as_str()
    }

    /// The truth value at a key.
    pub fn flag(&self, key: &str) -> Option<bool> {
        self.get(key)?.as_bool()
    }

    /// The numbers at a key: a list of any length.
    pub fn numbers(&self, key: &str) -> Option<Vec<f64>> {
        let item = self.get(key)?;
        (0..item.as_array()?.len()).map(|i| item.get(i).and_then(number)).collect()
    }

    /// The vector or colour at a key.
    pub fn vector(&self, key: &str) -> Option<[f64; 3]> {
        self.numbers(key)?.try_into().ok()
    }

    /// Entries of the list at a key; 0 if there is none.
    pub fn count(&self, key: &str) -> usize {
        let length = |item: &Item| item.as_array_of_tables().map(ArrayOfTables::len).or_else(|| Some(item.as_array()?.len()));
        self.get(key).and_then(length).unwrap_or(0)
    }

    /// Sets the value at a key. Tables on the way are made if they are missing.
    pub fn set(&mut self, key: &str, value: Value) -> Result<()> {
        edit::set(&mut self.toml, key, value)
    }

    /// Takes what is at a key out of the scene; returns whether there was something.
    pub fn remove(&mut self, key: &str) -> bool {
        let way: Vec<&str> = edit::parts(key).collect();
        let Some((last, way)) = way.split_last() else { return false };
        let parent = way.iter().try_fold(self.toml.as_item_mut(), |item, part| match part.parse::<usize>() {
            Ok(index) if !item.is_table_like() => item.get_mut(index),
            _ => item.as_table_like_mut()?.get_mut(part),
        });
        let Some(parent) = parent else { return false };
        let index = last.parse::<usize>().ok();
        match (parent, index) {
            (Item::ArrayOfTables(tables), Some(index)) if index < tables.len() => {
                tables.remove(index);
                true
            }
            (Item::Value(Value::Array(values)), Some(index)) if index < values.len() => {
                values.remove(index);
                true
            }
            (item, _) => item.as_table_like_mut().is_some_and(|table| table.remove(last).is_some()),
        }
    }

    /// Writes the text to a file, which becomes its own. Refuses its file if that has changed since it was read.
    pub fn save(&mut self, path: &Path) -> Result<()> {
        let fail = |source| Error::Io { path: path.into(), source };
        let now = stamp_of(path);
        if self.path() == Some(path) && now.is_some() && now != self.stamp {
            return Err(fail(std::io::Error::other("it has changed since it was read; remove it to save this scene in its place")));
        }
        let text = self.text();
        // The file that a link leads to, not the link.
        let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        write_atomically(&target, |to| std::fs::write(to, &text).map_err(fail))?;
        (self.path, self.stamp) = (Some(path.to_owned()), stamp_of(path));
        self.overrides.clear();
        Ok(())
    }
}

fn stamp_of(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

fn number(item: &Item) -> Option<f64> {
    item.as_float().or_else(|| item.as_integer().map(|v| v as f64))
}
