//! Triangle meshes from OBJ with MTL and from glTF, with the materials the file gives them.

use super::file::MaterialKind;
use super::texture::Image;
use super::{Material, Scene};
use crate::error::{Error, Result};
use glam::{DMat4, DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;

/// Triangles with vertex attributes.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertices.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, one per vertex, or none at all.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one per vertex, or none at all; (0, 0) is the lower left.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertices per triangle.
    pub indices: Vec<[u32; 3]>,
}

impl Mesh {
    /// The mesh under an affine map.
    pub fn transformed(mut self, transform: DMat4) -> Mesh {
        if transform == DMat4::IDENTITY {
            return self;
        }
        for p in &mut self.positions {
            *p = transform.transform_point3(Vec3::from(*p).as_dvec3()).as_vec3().to_array();
        }
        let normal_map = transform.inverse().transpose();
        for n in &mut self.normals {
            let mapped: DVec3 = normal_map.transform_vector3(Vec3::from(*n).as_dvec3());
            *n = mapped.normalize_or_zero().as_vec3().to_array();
        }
        // A mirror image turns triangles inside out.
        if transform.determinant() < 0.0 {
            self.indices.iter_mut().for_each(|t| t.swap(1, 2));
        }
        self
    }

    fn check(&self, path: &Path) -> Result<()> {
        let asset = |reason: String| Err(Error::Asset { path: path.into(), reason });
        let count = self.positions.len();
        if let Some(bad) = self.indices.iter().flatten().find(|&&i| i as usize >= count) {
            return asset(format!("a face uses vertex {}, expected at most {count}", bad + 1));
        }
        if let Some(i) = self.positions.iter().position(|p| !p.iter().all(|v| v.is_finite() && v.abs() < 1e9)) {
            return asset(format!("vertex {} is {:?}, expected finite numbers below 1e9", i + 1, self.positions[i]));
        }
        Ok(())
    }
}

/// What a mesh file holds. Indices count within the file.
#[derive(Clone, Debug, Default)]
pub struct MeshFile {
    /// Meshes with one material each, if they name one.
    pub parts: Vec<(Mesh, Option<usize>)>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Textures.
    pub images: Vec<Arc<Image>>,
}

impl MeshFile {
    /// Appends the materials and textures to a scene; returns the meshes with the scene's index of their material.
    pub fn add_to<'a>(&'a self, scene: &mut Scene) -> impl Iterator<Item = (&'a Mesh, usize)> + use<'a> {
        let (first_material, first_image) = (scene.materials.len(), scene.images.len());
        scene.images.extend(self.images.iter().cloned());
        scene.materials.extend(
            self.materials.iter().map(|m| Material { textures: m.textures.map(|t| t.map(|image| first_image + image)), ..m.clone() }),
        );
        self.parts.iter().map(move |(mesh, material)| (mesh, material.map_or(0, |i| first_material + i)))
    }
}

/// Reads a mesh file with its materials and textures.
pub fn read_mesh(path: &Path) -> Result<MeshFile> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let file = match extension.as_str() {
        "obj" => read_obj(path)?,
        "gltf" | "glb" => read_gltf(path)?,
        _ => return Err(Error::Asset { path: path.into(), reason: format!("a mesh of type `{extension}`, expected obj, gltf or glb") }),
    };
    for (mesh, _) in &file.parts {
        mesh.check(path)?;
    }
    if file.parts.iter().all(|(m, _)| m.indices.is_empty()) {
        return Err(Error::Asset { path: path.into(), reason: "no faces, expected triangles or polygons".into() });
    }
    Ok(file)
}

fn triples<T: Copy>(values: &[T]) -> Vec<[T; 3]> {
    values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}

fn read_obj(path: &Path) -> Result<MeshFile> {
    let file = std::fs::File::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let asset = |reason: String| Error::Asset { path: path.into(), reason };
    let library_error = std::cell::RefCell::new(None);
    let (models, materials) = tobj::load_obj_buf(&mut std::io::BufReader::new(file), &options, |name| {
        let loaded = tobj::load_mtl(folder.join(name));
        if let Err(e) = &loaded {
            *library_error.borrow_mut() = Some(format!("material library `{}`: {e}", name.display()));
        }
        loaded
    })
    .map_err(|e| asset(format!("not a mesh that can be read (OBJ): {e}")))?;
    if let Some(reason) = library_error.into_inner() {
        return Err(asset(reason));
    }
    let materials = materials.map_err(|e| asset(format!("material library: {e}")))?;
    let mut read = MeshFile::default();
    for m in &materials {
        read.materials.push(mtl_material(m, folder, &mut read.images)?);
    }
    for model in models {
        let m = model.mesh;
        let mesh = Mesh {
            positions: triples(&m.positions),
            normals: triples(&m.normals),
            uvs: m.texcoords.chunks_exact(2).map(|c| [c[0], c[1]]).collect(),
            indices: triples(&m.indices),
        };
        // tobj accepts indices it cannot resolve in single-index mode only by failing, but a mesh may still lack attributes.
        if !mesh.normals.is_empty() && mesh.normals.len() != mesh.positions.len() {
            return Err(asset(format!("object `{}` has {} normals for {} vertices", model.name, mesh.normals.len(), mesh.positions.len())));
        }
        if !mesh.uvs.is_empty() && mesh.uvs.len() != mesh.positions.len() {
            return Err(asset(format!(
                "object `{}` has {} texture coordinates for {} vertices",
                model.name,
                mesh.uvs.len(),
                mesh.positions.len()
            )));
        }
        read.parts.push((mesh, m.material_id));
    }
    Ok(read)
}

/// A material of an MTL library: Ke emits, illum 4, 6, 7 or d < 1 is glass, Pm or illum 3 is metal, the rest is diffuse.
fn mtl_material(m: &tobj::Material, folder: &Path, images: &mut Vec<Arc<Image>>) -> Result<Material> {
    let parameter = |name: &str| m.unknown_param.get(name);
    let number = |name: &str| -> Option<f32> { parameter(name)?.split_whitespace().next()?.parse().ok() };
    let emission = m.emissive.unwrap_or([0.0; 3]).map(|c| c.clamp(0.0, 1e9));
    let mut texture = |name: Option<&String>, data| match name {
        Some(name) => {
            images.push(Arc::new(Image::read(&folder.join(name), data)?));
            Ok(Some(images.len() - 1))
        }
        None => Ok(None),
    };
    let textures = [texture(m.diffuse_texture.as_ref(), false)?, texture(parameter("map_Pr"), true)?, texture(parameter("map_Ke"), false)?];
    let emits = emission.iter().any(|&v| v > 0.0);
    let illumination = m.illumination_model.unwrap_or(2);
    let glass = matches!(illumination, 4 | 6 | 7) || m.dissolve.is_some_and(|d| d < 1.0);
    let metal = number("Pm").is_some_and(|v| v >= 0.5) || illumination == 3;
    let kind = match (emits, glass, metal) {
        (true, ..) => MaterialKind::Emissive,
        (_, true, _) => MaterialKind::Dielectric,
        (_, _, true) => MaterialKind::Metallic,
        _ => MaterialKind::Diffuse,
    };
    let from_shininess = m.shininess.map(|s| (2.0 / (s.max(0.0) + 2.0)).sqrt().sqrt());
    let roughness = if glass && number("Pr").is_none() { 0.0 } else { number("Pr").or(from_shininess).unwrap_or(0.5) };
    let color = if textures[0].is_some() || glass { [1.0; 3] } else { m.diffuse.unwrap_or([0.8; 3]) };
    Ok(Material {
        name: m.name.clone(),
        kind,
        base_color: color.map(|c| c.clamp(0.0, 1.0)),
        roughness: roughness.clamp(0.0, 1.0),
        ior: m.optical_density.filter(|i| (1.0..=10.0).contains(i)).unwrap_or(1.5),
        emission,
        textures,
        ..Material::default()
    })
}

fn read_gltf(path: &Path) -> Result<MeshFile> {
    let asset = |reason: String| Error::Asset { path: path.into(), reason };
    let (document, buffers, images) = gltf::import(path).map_err(|e| asset(format!("not a mesh that can be read (glTF): {e}")))?;
    let mut read = MeshFile::default();
    for (i, image) in images.into_iter().enumerate() {
        // Roughness textures hold data, colours are sRGB.
        let data = document
            .materials()
            .any(|m| m.pbr_metallic_roughness().metallic_roughness_texture().is_some_and(|t| t.texture().source().index() == i));
        let decoded = gltf_image(image).ok_or_else(|| asset(format!("image {i} has a pixel format that is not supported")))?;
        read.images.push(Arc::new(Image::from_dynamic(&decoded, data)));
    }
    read.materials.extend(document.materials().map(|m| gltf_material(&m)));
    let root = document.default_scene().or_else(|| document.scenes().next()).ok_or_else(|| asset("no scene".into()))?;
    let mut todo: Vec<(gltf::Node, DMat4)> = root.nodes().map(|n| (n, DMat4::IDENTITY)).collect();
    while let Some((node, parent)) = todo.pop() {
        let local = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
        let world = parent * local;
        todo.extend(node.children().map(|c| (c, world)));
        for primitive in node.mesh().iter().flat_map(|m| m.primitives()) {
            if primitive.mode() != gltf::mesh::Mode::Triangles {
                continue;
            }
            let reader = primitive.reader(|b| buffers.get(b.index()).map(|d| d.0.as_slice()));
            let positions: Vec<[f32; 3]> = reader.read_positions().ok_or_else(|| asset("a primitive without positions".into()))?.collect();
            let flat: Vec<u32> = match reader.read_indices() {
                Some(indices) => indices.into_u32().collect(),
                None => (0..positions.len() as u32).collect(),
            };
            let normals: Vec<[f32; 3]> = reader.read_normals().map(|n| n.collect()).unwrap_or_default();
            // glTF counts v from the top.
            let uvs: Vec<[f32; 2]> =
                reader.read_tex_coords(0).map(|t| t.into_f32().map(|[u, v]| [u, 1.0 - v]).collect()).unwrap_or_default();
            let attributes_fit = |n: usize| n == 0 || n == positions.len();
            if !attributes_fit(normals.len()) || !attributes_fit(uvs.len()) {
                return Err(asset("a primitive with fewer normals or texture coordinates than positions".into()));
            }
            let mesh = Mesh { positions, normals, uvs, indices: triples(&flat) };
            mesh.check(path)?;
            read.parts.push((mesh.transformed(world), primitive.material().index()));
        }
    }
    Ok(read)
}

fn gltf_image(image: gltf::image::Data) -> Option<image::DynamicImage> {
    use gltf::image::Format;
    let (w, h, pixels) = (image.width, image.height, image.pixels);
    Some(match image.format {
        Format::R8 => image::GrayImage::from_raw(w, h, pixels)?.into(),
        Format::R8G8 => image::GrayAlphaImage::from_raw(w, h, pixels)?.into(),
        Format::R8G8B8 => image::RgbImage::from_raw(w, h, pixels)?.into(),
        Format::R8G8B8A8 => image::RgbaImage::from_raw(w, h, pixels)?.into(),
        _ => return None,
    })
}

fn gltf_material(m: &gltf::Material) -> Material {
    let pbr = m.pbr_metallic_roughness();
    let [r, g, b, _] = pbr.base_color_factor();
    let emission = m.emissive_factor();
    let image = |t: Option<gltf::texture::Info>| t.map(|t| t.texture().source().index());
    let kind = if pbr.metallic_factor() >= 0.5 { MaterialKind::Metallic } else { MaterialKind::Diffuse };
    Material {
        name: m.name().unwrap_or("glTF material").to_owned(),
        kind,
        base_color: [r, g, b].map(|c| c.clamp(0.0, 1.0)),
        roughness: pbr.roughness_factor().clamp(0.0, 1.0),
        emission: emission.map(|c| c.max(0.0)),
        two_sided: m.double_sided(),
        textures: [image(pbr.base_color_texture()), image(pbr.metallic_roughness_texture()), image(m.emissive_texture())],
        ..Material::default()
    }
}
