//! The Vulkan instance, with validation when `NULLRAY_VALIDATION=1`.

use crate::error::{Error, Result};
use ash::{ext, vk};
use std::ffi::{CStr, CString, c_char};
use std::sync::atomic::{AtomicU64, Ordering};
use winit::raw_window_handle::RawDisplayHandle;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

static VALIDATION_MESSAGES: AtomicU64 = AtomicU64::new(0);

/// Warnings and errors the validation layers have reported in this process.
pub fn validation_messages() -> u64 {
    VALIDATION_MESSAGES.load(Ordering::Relaxed)
}

/// Names the call in a Vulkan error.
pub fn vulkan(call: &'static str) -> impl Fn(vk::Result) -> Error {
    move |result| Error::Vulkan { call, result: result.to_string() }
}

/// The loader and an instance.
pub struct Instance {
    /// The instance's functions.
    pub raw: ash::Instance,
    debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    names: bool,
    /// The loader. Unloads the library; must outlive everything above.
    pub(super) entry: ash::Entry,
}

impl Instance {
    /// Loads the Vulkan library and creates an instance, which needs no display.
    pub fn new() -> Result<Instance> {
        Instance::create(&[])
    }

    /// An instance that can draw to the windows of a display.
    pub fn for_display(display: RawDisplayHandle) -> Result<Instance> {
        let extensions = ash_window::enumerate_required_extensions(display)
            .map_err(|_| Error::NoDevice { missing: "Vulkan does not draw to this kind of window".into() })?;
        Instance::create(extensions)
    }

    fn create(surface_extensions: &[*const c_char]) -> Result<Instance> {
        let no_device = |missing: String| Error::NoDevice { missing };
        // SAFETY: the loader library has no requirements beyond being a Vulkan loader.
        let entry = unsafe { ash::Entry::load() }.map_err(|_| no_device("the Vulkan loader (libvulkan.so.1) is not installed".into()))?;
        let validate = std::env::var("NULLRAY_VALIDATION").is_ok_and(|v| v == "1");
        let app_name = CString::from(c"nullray");
        let app = vk::ApplicationInfo::default().application_name(&app_name).api_version(vk::API_VERSION_1_3);
        let mut layers = vec![];
        let mut extensions = surface_extensions.to_vec();
        if validate {
            // SAFETY: `entry` is a loaded Vulkan library.
            let available = unsafe { entry.enumerate_instance_layer_properties() }.map_err(vulkan("vkEnumerateInstanceLayerProperties"))?;
            if !available.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
                return Err(no_device("NULLRAY_VALIDATION=1 is set but VK_LAYER_KHRONOS_validation is not installed".into()));
            }
            layers.push(VALIDATION_LAYER.as_ptr());
        }
        // Names and labels for validation messages and captures: they cost next to nothing, so they are there whenever they can be.
        // SAFETY: as above.
        let offered =
            unsafe { entry.enumerate_instance_extension_properties(None) }.map_err(vulkan("vkEnumerateInstanceExtensionProperties"))?;
        let names = validate || offered.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::debug_utils::NAME));
        if names {
            extensions.push(ext::debug_utils::NAME.as_ptr());
        }
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let mut info =
            vk::InstanceCreateInfo::default().application_info(&app).enabled_layer_names(&layers).enabled_extension_names(&extensions);
        if validate {
            info = info.push_next(&mut features);
        }
        // SAFETY: `info` and everything it points to lives until the call returns; the names of extensions are constants.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|e| no_device(format!("no instance: {e}")))?;
        let debug = if validate { Some(messenger(&entry, &raw)?) } else { None };
        Ok(Instance { raw, debug, names, entry })
    }

    /// The functions that name objects and commands of a device, if there are any.
    pub fn names(&self, device: &ash::Device) -> Option<ext::debug_utils::Device> {
        let functions = [c"vkSetDebugUtilsObjectNameEXT", c"vkCmdBeginDebugUtilsLabelEXT", c"vkCmdEndDebugUtilsLabelEXT"];
        // SAFETY: the device belongs to this instance. A loader may offer the extension for a driver that lacks its functions.
        let found = |name: &CStr| unsafe { self.raw.get_device_proc_addr(device.handle(), name.as_ptr()) }.is_some();
        (self.names && functions.into_iter().all(found)).then(|| ext::debug_utils::Device::new(&self.raw, device))
    }
}

fn messenger(entry: &ash::Entry, raw: &ash::Instance) -> Result<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)> {
    let functions = ext::debug_utils::Instance::new(entry, raw);
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(report));
    // SAFETY: the extension is enabled and the callback has the required signature.
    let handle = unsafe { functions.create_debug_utils_messenger(&info, None) }.map_err(vulkan("vkCreateDebugUtilsMessengerEXT"))?;
    Ok((functions, handle))
}

/// Counts and prints a message of the validation layers.
///
/// # Safety
/// Called by Vulkan, which guarantees that `data` is valid during the call.
unsafe extern "system" fn report(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    _: *mut std::ffi::c_void,
) -> vk::Bool32 {
    VALIDATION_MESSAGES.fetch_add(1, Ordering::Relaxed);
    // SAFETY: Vulkan passes a valid structure whose message is a string or null.
    let text = unsafe { data.as_ref().and_then(|d| d.message_as_c_str()) };
    eprintln!("nullray: validation: {}", text.map(CStr::to_string_lossy).unwrap_or_default());
    vk::FALSE
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold an `Arc` of the instance, so none is left; the messenger belongs to it.
        unsafe {
            if let Some((functions, handle)) = &self.debug {
                functions.destroy_debug_utils_messenger(*handle, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}
