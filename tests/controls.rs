//! Every control of the viewer's panels in every scene of assets/scenes: wherever it is set, the scene stays one that is accepted.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use glam::DVec3;
use nullray::scene::Assets;
use nullray::scene::file::SceneFile;
use nullray::viewer::document::Document;
use nullray::viewer::model::Action;
use nullray::viewer::parameters::{self, Control, Group, Parameter, admissible, array, remove, set, settle};
use nullray::viewer::subject::pose_of;
use nullray::world::World;
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;
use support::root;
use toml_edit::Value;

/// Largest coordinate and brightness that the panels let through.
const REACH: f64 = 1e6;

/// Compiling takes most of the time: every so manieth choice is taken that far, others in each scene.
const SHARE: usize = 8;

/// The one scene in which the switch to a disc of dust is solved for; that takes a second.
const BUILT_IN: &str = "singularity.toml";

/// How far an edited scene is taken.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    /// Every value is one that its key may have.
    Read,
    /// The values go together.
    Load,
    /// Light can be followed.
    Compile,
}

/// What a person can do with a control.
struct Edit {
    key: String,
    actions: Vec<Action>,
    /// The end of the range it goes to, 0 or 1; choices and buttons have none.
    end: Option<usize>,
    /// Whether it is compiled in every scene.
    always: bool,
}

/// Whether light or matter moves in another way for it, so that more than the loader could refuse the scene.
fn bends(key: &str) -> bool {
    key.starts_with("spacetime.") || key.starts_with("accretion_disc.")
}

fn scalar(values: &[f64]) -> Value {
    values[0].into()
}

fn edits(document: &Document, camera: DVec3) -> Vec<Edit> {
    let rest = [parameters::camera(document), parameters::integrator(document), parameters::film()].concat();
    let groups = [
        parameters::spacetime(document),
        parameters::materials(document),
        parameters::discs(document),
        parameters::environment(document),
        vec![Group { parameters: rest, ..Group::default() }],
    ]
    .concat();
    let mut edits = vec![];
    for group in &groups {
        edits.extend(group.parameters.iter().flat_map(|parameter| edits_of(document, camera, parameter)));
        edits.extend(group.buttons.iter().filter(|(_, actions)| admissible(document, camera, actions)).filter_map(|(_, actions)| {
            let (Action::Set { key, .. } | Action::Remove { key }) = actions.first()? else { return None };
            Some(Edit { key: key.clone(), actions: actions.clone(), end: None, always: false })
        }));
    }
    edits
}

/// Numbers go to both ends of their range as far as the scene lets them, vectors and colours with all components at once; of options
/// all are chosen that the scene admits.
fn edits_of(document: &Document, camera: DVec3, parameter: &Parameter) -> Vec<Edit> {
    let key = parameter.key.as_str();
    let settled = |from: &[f64], to: &[f64], value: fn(&[f64]) -> Value| settle(document, camera, key, from, to, value);
    let ends: Vec<Option<Action>> = match &parameter.control {
        Control::Number(number) => {
            let now = document.number(key).unwrap_or(number.fallback);
            [*number.range.start(), *number.range.end()].map(|end| settled(&[now], &[end], scalar)).into()
        }
        Control::Whole { range, .. } => [*range.start(), *range.end()].map(|end| Some(set(key, end))).into(),
        Control::Vector { fallback, .. } => {
            let now = document.vector(key).unwrap_or(*fallback);
            [-REACH, REACH].map(|end| settled(&now, &[end; 3], array)).into()
        }
        Control::Color { bright, .. } => [0.0, if *bright { REACH } else { 1.0 }].map(|end| Some(set(key, array(&[end; 3])))).into(),
        Control::List { range, .. } => {
            let now = document.numbers(key).unwrap_or_default();
            let moved = |i: usize, end: f64| {
                let mut to = now.clone();
                to[i] = end;
                settled(&now, &to, array)
            };
            (0..now.len()).flat_map(|i| [moved(i, *range.start()), moved(i, *range.end())]).collect()
        }
        Control::Flag { .. } => [false, true].map(|end| Some(set(key, end))).into(),
        Control::Choice { options, fallback, choose } => {
            let now = document.word(key).unwrap_or(fallback);
            let others = options.iter().filter(|(option, _)| *option != now).map(|&(option, _)| choose(document, key, option));
            return others
                .filter(|actions| admissible(document, camera, actions))
                .map(|actions| Edit { key: key.to_owned(), actions, end: None, always: false })
                .collect();
        }
    };
    let always = bends(key) && matches!(parameter.control, Control::Number(_));
    let edit = |(i, action): (usize, Option<Action>)| Some(Edit { key: key.to_owned(), actions: vec![action?], end: Some(i % 2), always });
    ends.into_iter().enumerate().filter_map(edit).collect()
}

/// Keys and values of an edit.
fn told(actions: &[Action]) -> String {
    let one = |action: &Action| match action {
        Action::Set { key, value } => format!("{key} = {}", value.to_string().trim()),
        Action::Remove { key } => format!("without {key}"),
        other => format!("{other:?}"),
    };
    actions.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// A scene, and what was found about edits of it.
struct Subject<'a> {
    name: &'a str,
    document: Document,
    assets: Assets,
    /// How many edited scenes were taken to each stage.
    taken: [usize; 3],
    failures: Vec<String>,
}

impl<'a> Subject<'a> {
    fn open(name: &'a str) -> Subject<'a> {
        let document = Document::open(Some(&root().join("assets/scenes").join(name)), &[]).unwrap();
        Subject { name, document, assets: Assets::default(), taken: [0; 3], failures: vec![] }
    }

    /// Takes the edited scene to a stage and notes what refuses it; says whether nothing did.
    fn check(&mut self, actions: &[Action], stage: Stage) -> bool {
        self.taken[stage as usize] += 1;
        let outcome = catch_unwind(AssertUnwindSafe(|| self.take(actions, stage))).unwrap_or_else(|_| Err("it panics".into()));
        if let Err(reason) = &outcome {
            self.failures.push(format!("{}: {}: {reason}", self.name, told(actions)));
        }
        outcome.is_ok()
    }

    fn take(&mut self, actions: &[Action], stage: Stage) -> Result<(), String> {
        let mut edited = self.document.clone();
        for action in actions {
            match action {
                Action::Set { key, value } => edited.set(key, value.clone()).map_err(|e| e.to_string())?,
                Action::Remove { key } if edited.remove(key) => {}
                other => return Err(format!("cannot do {other:?}")),
            }
        }
        let _: SceneFile = toml::from_str(&edited.text()).map_err(|e| e.message().to_owned())?;
        if stage == Stage::Read {
            return Ok(());
        }
        let scene = edited.to_scene(&mut self.assets).map_err(|e| e.to_string())?;
        if stage == Stage::Compile {
            World::compile(&scene).map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    /// How far an edit is taken on its own.
    fn stage(&self, edit: &Edit, shared: bool) -> Stage {
        let kind = edit.actions.iter().find_map(|action| match action {
            Action::Set { key, value } if key == "spacetime.kind" => value.as_str(),
            _ => None,
        });
        if kind.or(self.document.word("spacetime.kind")) == Some("dust-disc") {
            return if edit.key == "spacetime.mu" || self.name == BUILT_IN { Stage::Compile } else { Stage::Read };
        }
        if edit.always || (bends(&edit.key) && shared) {
            Stage::Compile
        } else if edit.end.is_none() && shared {
            Stage::Load
        } else {
            Stage::Read
        }
    }

    /// Sets everything at once that does not bend light to one end of its range. If that is refused, each is tried alone.
    fn check_together(&mut self, edits: &[Edit], end: usize, stage: Stage) {
        let edits: Vec<&Edit> = edits.iter().filter(|edit| edit.end == Some(end) && !bends(&edit.key)).collect();
        let all: Vec<Action> = edits.iter().flat_map(|edit| edit.actions.clone()).collect();
        if !self.check(&all, stage) {
            for edit in edits {
                self.check(&edit.actions, stage);
            }
        }
    }
}

/// What the controls of a scene do that they should not; `turn` chooses which of the choices are compiled.
fn failures(turn: usize, name: &str) -> Vec<String> {
    let start = Instant::now();
    let mut subject = Subject::open(name);
    let camera = pose_of(&subject.document).position;
    if !admissible(&subject.document, camera, &[]) {
        subject.failures.push(format!("{name}: it is not admissible as it stands"));
    }
    let edits = edits(&subject.document, camera);
    assert!(edits.len() > 20, "{name}: {} edits", edits.len());
    for (i, edit) in edits.iter().enumerate() {
        subject.check(&edit.actions, subject.stage(edit, (turn + i).is_multiple_of(SHARE)));
    }
    let slow = subject.document.word("spacetime.kind") == Some("dust-disc");
    for (end, stage) in [Stage::Load, Stage::Compile].into_iter().enumerate() {
        subject.check_together(&edits, end, if slow { Stage::Read } else { stage });
    }
    let [read, loaded, compiled] = subject.taken;
    println!("{name}: {read} edits read, {loaded} loaded, {compiled} compiled in {:.1?}", start.elapsed());
    subject.failures
}

#[test]
fn controls_leave_every_scene_valid() {
    let entries = std::fs::read_dir(root().join("assets/scenes")).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name.ends_with(".toml"));
    names.sort();
    assert!(names.len() >= 9);
    let failures: Vec<String> = names.par_iter().enumerate().flat_map_iter(|(turn, name)| failures(turn, name)).collect();
    assert!(failures.is_empty(), "{} edits are refused:\n{}", failures.len(), failures.join("\n"));
}

#[test]
fn a_refused_edit_is_named() {
    let mut subject = Subject::open(BUILT_IN);
    // Refused by the reader, the loader and the compiler, which finds the camera inside the hole.
    for (key, value, stage) in [
        ("spacetime.mass", "-1", Stage::Read),
        ("spacetime.mu", "0.5", Stage::Load),
        ("spacetime.position", "[0, 2.2, -8.95]", Stage::Compile),
    ] {
        assert!(!subject.check(&[set(key, value.parse::<Value>().unwrap())], stage), "{key} = {value} is accepted");
        let failure = subject.failures.pop().unwrap();
        assert!([BUILT_IN, key, value].iter().all(|part| failure.contains(part)), "{failure}");
    }
    assert!(!subject.check(&[remove("spacetime.charge")], Stage::Read), "nothing is removed");
}
