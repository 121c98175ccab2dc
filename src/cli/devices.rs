use crate::error::Result;
#[derive(clap::Args)]
pub struct DevicesArgs {}
pub fn run(_: &DevicesArgs) -> Result<()> { Ok(()) }
