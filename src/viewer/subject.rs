//! What is looked at and how: the scene document, the camera, the development, and which light is shown.

use super::document::{Document, Stamp};
use super::model::Action;
use super::navigation::{Eye, Pose};
use super::worker::{Request, Source};
use crate::backend::{Channel, Development};
use crate::error::Result;
use crate::scene::file::CameraTable;
use crate::scene::values::{Vector, numbers};
use crate::scene::{Scene, ToneMap};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;
use toml_edit::{Array, Value};

/// Digits after the point of what is saved of the camera.
const DIGITS: f64 = 1e6;
/// Largest coordinate of a scene.
const LARGEST: f64 = 1e9;
/// Fastest observer.
const FASTEST: f64 = 0.99;

/// The observer's velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// As the scene has it.
    Fixed(DVec3),
    /// Along the view.
    Along(f64),
}

/// Everything about the picture that a person can change.
pub struct Subject {
    document: Document,
    /// The document's text, and how often it changed.
    text: Arc<str>,
    number: u64,
    /// The last good scene, with the camera where it is now.
    scene: Scene,
    pose: Pose,
    motion: Motion,
    development: Development,
    bending: bool,
    split: Option<f64>,
    /// The file as it was last looked at.
    stamp: Stamp,
    /// Why the document could not be read or edited.
    trouble: Option<String>,
}

impl Subject {
    /// A document and the scene it describes.
    pub fn new(document: Document, scene: Scene, bending: bool) -> Subject {
        let film = &scene.film;
        let development =
            Development { channel: Channel::Radiance, exposure: film.exposure, tone_map: film.tone_map, columns: 0..u32::MAX };
        let mut subject = Subject {
            text: document.text().into(),
            number: 0,
            pose: pose_of(&document),
            motion: motion_of(&document),
            development,
            bending,
            split: None,
            stamp: document.stamp(),
            trouble: None,
            document,
            scene,
        };
        subject.place_camera();
        subject
    }

    /// The document.
    pub fn document(&self) -> &Document {
        &self.document
    }

    /// The last good scene, with the camera where it is now.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// How the film is developed.
    pub fn development(&self) -> &Development {
        &self.development
    }

    /// Whether light bends.
    pub fn bending(&self) -> bool {
        self.bending
    }

    /// Where straight light ends, as a share of the width.
    pub fn split(&self) -> Option<f64> {
        self.split
    }

    /// Where the camera is.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Speed of the observer along the view.
    pub fn velocity(&self) -> f64 {
        match self.motion {
            Motion::Fixed(velocity) => velocity.dot(self.pose.forward()),
            Motion::Along(speed) => speed,
        }
    }

    /// Why the document could not be read or edited.
    pub fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }

    /// Asks for the picture as it is to be now.
    pub fn request(&self, revision: u64, size: (u32, u32)) -> Request {
        Request {
            revision,
            source: Source { number: self.number, path: self.document.name(), text: self.text.clone() },
            eye: self.eye(),
            size,
            development: self.development.clone(),
            bending: self.bending,
            split: self.split,
        }
    }

    /// Moves the camera.
    pub fn navigate(&mut self, go: impl FnOnce(Pose) -> Pose) {
        self.pose = go(self.pose);
        self.place_camera();
    }

    /// Does what the panels ask for; returns what is not about the picture.
    pub fn apply(&mut self, actions: Vec<Action>) -> Vec<Action> {
        let mut others = vec![];
        let mut edited = false;
        for action in actions {
            match action {
                Action::Set { key, value } => {
                    self.trouble = self.document.set(&key, value).err().map(|e| e.to_string());
                    self.follow_document(&key);
                    edited = true;
                }
                Action::Remove { key } => {
                    self.document.remove(&key);
                    self.follow_document(&key);
                    edited = true;
                }
                Action::Channel(channel) => self.development.channel = channel,
                Action::Exposure(stops) => self.development.exposure = stops,
                Action::ToneMap(curve) => self.development.tone_map = curve,
                Action::Bending(on) => self.bending = on,
                Action::Split(at) => self.split = at.map(|at| at.clamp(0.0, 1.0)),
                Action::Velocity(speed) => self.motion = Motion::Along(speed.clamp(-FASTEST, FASTEST)),
                Action::ResetCamera => (self.pose, self.motion) = (pose_of(&self.document), motion_of(&self.document)),
                other => others.push(other),
            }
        }
        if edited {
            self.edited();
        }
        self.place_camera();
        others
    }

    /// Goes over to another document, which is known to describe a scene.
    pub fn open(&mut self, document: Document) {
        self.pose = pose_of(&document);
        self.motion = motion_of(&document);
        self.take(document);
    }

    /// Reads the file again if it has changed on disk; says whether it has.
    pub fn reload_if_changed(&mut self) -> bool {
        let stamp = self.document.stamp_now();
        // A file that is gone may be about to be replaced.
        if stamp == self.stamp || stamp.is_none() {
            return false;
        }
        self.stamp = stamp;
        match self.document.reread() {
            Ok(document) => {
                // The camera stays where it was flown to, unless it was moved in the file.
                if pose_of(&document) != pose_of(&self.document) {
                    self.pose = pose_of(&document);
                }
                if motion_of(&document) != motion_of(&self.document) {
                    self.motion = motion_of(&document);
                }
                self.take(document);
            }
            Err(e) => self.trouble = Some(e.to_string()),
        }
        true
    }

    /// Takes note of the scene that the document with this number describes; says whether it is developed in another way.
    pub fn loaded(&mut self, number: u64, scene: Scene) -> bool {
        if number != self.number {
            return false;
        }
        let last = (self.development.exposure, self.development.tone_map);
        // What the file says about development holds when it changes.
        let (before, now) = (&self.scene.film, &scene.film);
        if before.exposure != now.exposure {
            self.development.exposure = now.exposure;
        }
        if before.tone_map != now.tone_map {
            self.development.tone_map = now.tone_map;
        }
        self.scene = scene;
        self.place_camera();
        (self.development.exposure, self.development.tone_map) != last
    }

    /// Writes the scene with the camera and the development as they are, to its file or to `fallback`; returns which it was.
    pub fn save(&mut self, fallback: impl FnOnce() -> PathBuf) -> Result<PathBuf> {
        let path = self.document.path().map_or_else(fallback, Path::to_owned);
        let (eye, home) = (self.eye(), pose_of(&self.document));
        let vectors = [
            ("camera.position", eye.pose.position, home.position),
            ("camera.look_at", eye.pose.look_at, home.look_at),
            ("camera.up", eye.pose.up, home.up),
            ("camera.velocity", eye.velocity, velocity_of(&self.document)),
        ];
        for (key, now, before) in vectors {
            if now != before {
                self.document.set(key, vector_value(now))?;
            }
        }
        // The scene has what its document says, so that only what changes from now on counts as a change.
        let film = &mut self.scene.film;
        if self.development.exposure != film.exposure {
            film.exposure = rounded(self.development.exposure);
            self.document.set("film.exposure", film.exposure.into())?;
        }
        if self.development.tone_map != film.tone_map {
            film.tone_map = self.development.tone_map;
            self.document.set("film.tone_map", tone_map_name(film.tone_map).into())?;
        }
        self.document.save(&path)?;
        self.stamp = self.document.stamp();
        Ok(path)
    }

    fn eye(&self) -> Eye {
        let velocity = match self.motion {
            Motion::Fixed(velocity) => velocity,
            Motion::Along(speed) => self.pose.forward() * speed,
        };
        Eye { pose: self.pose, velocity, follows_target: self.document.get("camera.focus_distance").is_none() }
    }

    fn place_camera(&mut self) {
        self.eye().apply(&mut self.scene.camera);
    }

    /// Puts a document in the place of the one there is.
    fn take(&mut self, document: Document) {
        self.stamp = document.stamp();
        self.document = document;
        self.trouble = None;
        self.edited();
        self.place_camera();
    }

    fn edited(&mut self) {
        self.text = self.document.text().into();
        self.number += 1;
    }

    /// Moves the camera to where an edit of the document has put it.
    fn follow_document(&mut self, key: &str) {
        let home = pose_of(&self.document);
        match key {
            "camera" => (self.pose, self.motion) = (home, motion_of(&self.document)),
            "camera.velocity" => self.motion = motion_of(&self.document),
            "camera.fov_degrees" => self.pose.fov = home.fov,
            _ if key.starts_with("camera.position") => self.pose.position = home.position,
            _ if key.starts_with("camera.look_at") => self.pose.look_at = home.look_at,
            _ if key.starts_with("camera.up") => self.pose.up = home.up,
            _ => {}
        }
    }
}

/// Where a document has the camera.
pub fn pose_of(document: &Document) -> Pose {
    let defaults = CameraTable::default();
    // What the loader refuses must not move the camera of the last good scene.
    let is_sane = |v: &[f64; 3]| v.iter().all(|c| c.abs() <= LARGEST);
    let vector = |key: &str, default: &Spanned<Vector>| {
        DVec3::from(document.vector(key).filter(is_sane).unwrap_or_else(|| numbers(*default.get_ref())))
    };
    let fov = document.number("camera.fov_degrees").filter(|f| *f > 0.0 && *f < 180.0);
    Pose {
        position: vector("camera.position", &defaults.position),
        look_at: vector("camera.look_at", &defaults.look_at),
        up: vector("camera.up", &defaults.up),
        fov: fov.unwrap_or(defaults.fov_degrees.0),
    }
}

fn velocity_of(document: &Document) -> DVec3 {
    let velocity = document.vector("camera.velocity").map_or(DVec3::ZERO, DVec3::from);
    if velocity.length() < 1.0 { velocity } else { DVec3::ZERO }
}

fn motion_of(document: &Document) -> Motion {
    Motion::Fixed(velocity_of(document))
}

fn rounded(value: f64) -> f64 {
    (value * DIGITS).round() / DIGITS
}

fn vector_value(vector: DVec3) -> Value {
    vector.to_array().into_iter().map(rounded).collect::<Array>().into()
}

fn tone_map_name(curve: ToneMap) -> &'static str {
    match curve {
        ToneMap::None => "none",
        ToneMap::Reinhard => "reinhard",
        ToneMap::Aces => "aces",
    }
}
