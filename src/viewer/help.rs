//! The keys of the viewer: one table, from which keys are dispatched and the help is written.

use crate::backend::Channel;
use Trigger::{Control, Named, Place, Printed};
use winit::keyboard::{Key, KeyCode, NamedKey, PhysicalKey};

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Show or hide the panels.
    Panels,
    /// Bend light or let it go straight.
    Bending,
    /// Straight light to the left of a line, bent light to the right of it.
    Split,
    /// Show or hide the keys.
    Help,
    /// Put the camera back where the scene has it.
    ResetCamera,
    /// Show another value of the film.
    Channel(Channel),
    /// Fly while the key is down: right, up, forward.
    Fly([i8; 3]),
    /// Turn around the target by one notch: right, up.
    Nudge([i8; 2]),
    /// Change the exposure by so many stops.
    Exposure(f64),
    /// Write the picture as a PNG.
    Screenshot,
    /// Write the film as an EXR.
    SaveFilm,
    /// Write the scene with its present state.
    SaveScene,
    /// Close the window, or what is open in it.
    Quit,
}

/// Which key is meant. Keys that move are found by their place, so that they lie together on every keyboard; the others by what is
/// printed on them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trigger {
    Place(KeyCode),
    Printed(&'static str),
    Control(&'static str),
    Named(NamedKey),
}

impl Trigger {
    fn matches(self, physical: PhysicalKey, logical: &Key, control: bool) -> bool {
        let printed = |letter: &str| matches!(logical, Key::Character(c) if c.eq_ignore_ascii_case(letter));
        match self {
            Trigger::Place(code) => !control && physical == PhysicalKey::Code(code),
            Trigger::Printed(letter) => !control && printed(letter),
            Trigger::Control(letter) => control && printed(letter),
            Trigger::Named(name) => *logical == Key::Named(name),
        }
    }
}

/// One line of the help. Mouse gestures have no key.
struct Entry {
    shown: &'static str,
    does: &'static str,
    keys: &'static [(Trigger, Command)],
}

const ENTRIES: &[Entry] = &[
    Entry { shown: "Left drag", does: "orbit around the target", keys: &[] },
    Entry { shown: "Right drag", does: "look around", keys: &[] },
    Entry { shown: "Wheel", does: "nearer or farther; while flying, faster or slower", keys: &[] },
    Entry { shown: "Click", does: "what is seen there, and the way its light came", keys: &[] },
    Entry {
        shown: "W A S D, Q E",
        does: "fly: forward, left, back, right, down, up",
        keys: &[
            (Place(KeyCode::KeyW), Command::Fly([0, 0, 1])),
            (Place(KeyCode::KeyS), Command::Fly([0, 0, -1])),
            (Place(KeyCode::KeyA), Command::Fly([-1, 0, 0])),
            (Place(KeyCode::KeyD), Command::Fly([1, 0, 0])),
            (Place(KeyCode::KeyQ), Command::Fly([0, -1, 0])),
            (Place(KeyCode::KeyE), Command::Fly([0, 1, 0])),
        ],
    },
    Entry {
        shown: "Arrows",
        does: "nudge the camera around the target",
        keys: &[
            (Named(NamedKey::ArrowLeft), Command::Nudge([-1, 0])),
            (Named(NamedKey::ArrowRight), Command::Nudge([1, 0])),
            (Named(NamedKey::ArrowUp), Command::Nudge([0, 1])),
            (Named(NamedKey::ArrowDown), Command::Nudge([0, -1])),
        ],
    },
    Entry { shown: "R", does: "camera back to where the scene has it", keys: &[(Printed("r"), Command::ResetCamera)] },
    Entry { shown: "B", does: "bending on or off", keys: &[(Printed("b"), Command::Bending)] },
    Entry { shown: "V", does: "split view: straight on the left, bent on the right", keys: &[(Printed("v"), Command::Split)] },
    Entry {
        shown: "1 - 9, 0",
        does: "channel of the film, 1 is the picture",
        keys: &[
            (Place(KeyCode::Digit1), Command::Channel(Channel::Radiance)),
            (Place(KeyCode::Digit2), Command::Channel(Channel::Albedo)),
            (Place(KeyCode::Digit3), Command::Channel(Channel::Normal)),
            (Place(KeyCode::Digit4), Command::Channel(Channel::Distance)),
            (Place(KeyCode::Digit5), Command::Channel(Channel::Redshift)),
            (Place(KeyCode::Digit6), Command::Channel(Channel::Steps)),
            (Place(KeyCode::Digit7), Command::Channel(Channel::Chords)),
            (Place(KeyCode::Digit8), Command::Channel(Channel::Status)),
            (Place(KeyCode::Digit9), Command::Channel(Channel::ConstraintError)),
            (Place(KeyCode::Digit0), Command::Channel(Channel::Cost)),
        ],
    },
    Entry {
        shown: "+  -",
        does: "exposure, a third of a stop",
        keys: &[
            (Printed("+"), Command::Exposure(1.0 / 3.0)),
            (Printed("="), Command::Exposure(1.0 / 3.0)),
            (Printed("-"), Command::Exposure(-1.0 / 3.0)),
        ],
    },
    Entry { shown: "Tab", does: "show or hide the panels", keys: &[(Named(NamedKey::Tab), Command::Panels)] },
    Entry { shown: "F1, H", does: "these keys", keys: &[(Named(NamedKey::F1), Command::Help), (Printed("h"), Command::Help)] },
    Entry { shown: "P", does: "save the picture (PNG)", keys: &[(Printed("p"), Command::Screenshot)] },
    Entry { shown: "F", does: "save the film (EXR)", keys: &[(Printed("f"), Command::SaveFilm)] },
    Entry { shown: "Ctrl+S", does: "save the scene with its present state", keys: &[(Control("s"), Command::SaveScene)] },
    Entry { shown: "Esc", does: "close these keys or a menu, or quit", keys: &[(Named(NamedKey::Escape), Command::Quit)] },
];

/// What a key asks for, by its place, by what it types, and by whether Ctrl is down with it.
pub fn command(physical: PhysicalKey, logical: &Key, control: bool) -> Option<Command> {
    let mut keys = ENTRIES.iter().flat_map(|entry| entry.keys);
    keys.find(|(trigger, _)| trigger.matches(physical, logical, control)).map(|(_, command)| *command)
}

/// The list of keys, as a window in the middle. Returns whether it stays open.
pub fn show(ctx: &egui::Context) -> bool {
    let mut open = true;
    egui::Window::new("Keys")
        .open(&mut open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            egui::Grid::new("keys").num_columns(2).spacing([24.0, 6.0]).show(ui, |ui| {
                for entry in ENTRIES {
                    ui.label(egui::RichText::new(entry.shown).monospace().strong());
                    ui.label(entry.does);
                    ui.end_row();
                }
            });
            ui.add_space(6.0);
            ui.weak("Drop a scene file on the window to open it. An open file is read again when it changes on disk.");
        });
    open
}
