//! stub
use super::*;
use crate::error::Error;
pub struct VulkanBackend;
impl VulkanBackend {
    pub fn new(_: Option<&str>) -> Result<Self> { Err(Error::NoDevice { missing: "stub".into() }) }
    pub fn is_software(&self) -> bool { true }
}
impl Backend for VulkanBackend {
    fn name(&self) -> String { String::new() }
    fn upload(&mut self, _: Arc<World>, _: Precision, _: u32) -> Result<()> { Ok(()) }
    fn accumulate(&mut self, _: Range<u32>, _: Range<u32>) -> Result<()> { Ok(()) }
    fn film(&mut self) -> Result<Film> { Err(Error::Interrupted) }
    fn trace(&mut self, _: &[TraceRay], _: TraceOptions) -> Result<Vec<TraceResult>> { Ok(vec![]) }
    fn timings(&mut self) -> Vec<KernelTiming> { vec![] }
}
