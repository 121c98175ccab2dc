//! Assignments to the keys of a scene file: comments, order and form of what is there survive.
//!
//! A key is names and indices from 0 joined by dots, such as `spacetime.center.0.strength`; indices may also stand in brackets. The
//! index after the last entry of a list appends to it.

use crate::error::{Error, Result};
use toml_edit::{ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value};

/// Makes the assignment `key.path=value`, the value in TOML syntax or a bare word, so that `spacetime.kind=flat` needs no quotes.
/// Fails with [`Error::Override`], which names it.
pub fn assign(document: &mut DocumentMut, assignment: &str) -> Result<()> {
    let fail = |reason: String| Error::Override { assignment: assignment.into(), reason };
    let (key, text) = assignment.split_once('=').ok_or_else(|| fail("expected key.path=value".into()))?;
    let text = text.trim();
    let is_word = !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || "-_./".contains(c));
    let value = match text.parse::<Value>() {
        Ok(value) => value,
        Err(_) if is_word => text.into(),
        Err(_) if text.is_empty() => return Err(fail("expected a value".into())),
        Err(e) => return Err(fail(one_line(e.message()))),
    };
    put_at(document, key, value).map_err(fail)
}

/// Sets `key` to a value; what leads there is made if it is missing. Fails with [`Error::Override`] where something else is in the way.
pub fn set(document: &mut DocumentMut, key: &str, value: Value) -> Result<()> {
    let assignment = format!("{key}={}", value.to_string().trim());
    put_at(document, key, value).map_err(|reason| Error::Override { assignment, reason })
}

/// The parts of a key.
pub fn parts(key: &str) -> impl Iterator<Item = &str> {
    key.split(['.', '[', ']']).map(str::trim).filter(|part| !part.is_empty())
}

/// Line and column, from 1, of a place in a text.
pub fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..offset.min(text.len())];
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
    (line, column)
}

/// A message of the parser in one line.
pub fn one_line(message: &str) -> String {
    message.split('\n').map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(", ")
}

fn put_at(document: &mut DocumentMut, key: &str, value: Value) -> std::result::Result<(), String> {
    let way: Vec<&str> = parts(key).collect();
    if way.is_empty() {
        return Err("expected key.path=value".into());
    }
    put(document.as_item_mut(), &way, 0, value)
}

/// Puts a value at the end of a way into `item`, `depth` parts of which were taken.
fn put(item: &mut Item, way: &[&str], depth: usize, value: Value) -> std::result::Result<(), String> {
    let Some(part) = way.get(depth) else {
        replace(item, value, depth == 1);
        return Ok(());
    };
    let Some(index) = part.parse::<usize>().ok().filter(|_| !item.is_table_like()) else {
        if item.is_none() {
            *item = Item::Table(Table::new());
        }
        let inline = item.is_inline_table();
        let table = item.as_table_like_mut().ok_or_else(|| format!("`{part}` is not in a table"))?;
        let child = table.entry(part).or_insert(Item::None);
        // A value holds values only, so what is made inside an inline table is inline too.
        if inline && child.is_none() && depth + 1 < way.len() {
            *child = Item::Value(Value::InlineTable(InlineTable::new()));
        }
        return put(child, way, depth + 1, value);
    };
    if item.is_none() {
        *item = Item::ArrayOfTables(ArrayOfTables::new());
    }
    let whole_entry = depth + 1 == way.len();
    let count = match item {
        Item::ArrayOfTables(_) if whole_entry && !value.is_inline_table() => return Err(format!("`{part}` is a table")),
        Item::ArrayOfTables(tables) => {
            if index == tables.len() {
                tables.push(Table::new());
            }
            tables.len()
        }
        Item::Value(Value::Array(values)) => {
            if index == values.len() {
                values.push(InlineTable::new());
            }
            values.len()
        }
        _ => return Err(format!("`{part}` is not in a list")),
    };
    let entry = item.get_mut(index).ok_or_else(|| format!("found `{part}`, expected an index of at most {count}"))?;
    put(entry, way, depth + 1, value)
}

/// Replaces an item by a value, in the form and with the comments that the item has. `top` says that it is a table of the file.
fn replace(item: &mut Item, mut value: Value, top: bool) {
    value.decor_mut().clear();
    *item = match (std::mem::take(item), value) {
        (Item::Table(old), Value::InlineTable(new)) => {
            let mut new = new.into_table();
            new.set_position(old.position());
            *new.decor_mut() = old.decor().clone();
            Item::Table(new)
        }
        (Item::None, Value::InlineTable(new)) if top => Item::Table(new.into_table()),
        (Item::Value(old), mut new) => {
            *new.decor_mut() = old.decor().clone();
            Item::Value(new)
        }
        (_, new) => Item::Value(new),
    };
}
