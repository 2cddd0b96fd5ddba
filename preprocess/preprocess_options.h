#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "preprocess/import/cad/cad_reading.h"
#include "preprocess/import/foreign/foreign.h"
#include "preprocess/import/gltf/gltf_decoding.h"
#include "preprocess/ingest/scene_coordinates.h"
#include "preprocess/texture/image_decoder.h"
#include "preprocess/up_axis.h"

namespace quarry {

struct PreprocessOptions {
  std::vector<std::string> models;
  std::string output;
  std::string tmp_folder;        ///< for spill; empty: the output's folder
  uint64_t memory = 1ull << 30;  ///< bytes, a ceiling
  unsigned threads = 1;
  uint32_t voxel_size = 256u << 10;  ///< bytes of a decoded hot block, at most
  uint32_t up_axis = 0;              ///< 1 for y, 2 for z; 0: guessed from the triangles and `up_habit`
  UpHabit up_habit;                  ///< further evidence about the up axis
  double scale = 1;
  /// Crease angle in degrees: up to it, triangles without normals meet smoothly. 0: nothing is smoothed.
  double crease = 30;
  /// Of STEP and IGES: most distance of triangles from surfaces, of the file's unit, and degrees between
  /// neighbouring triangles. 0: by the model's size, and the default.
  double linear_deflection = 0, angular_deflection = 0;
  std::map<std::string, Placement> placements;  ///< of some models, by the path given
  bool textures = true;                         ///< carry the images that materials name
  double checkpoint_seconds = 5;  ///< of work that is repeated after a kill, or one unit of work
  /// Whether to continue an earlier run of the same options. With kIfFit, a run that cannot continue (another
  /// version, changed models) begins anew.
  enum class Resume { kNo, kYes, kIfFit };
  Resume resume = Resume::kNo;
  /// The sentence for the user about how to continue.
  std::string goes_on = "the same command with --resume continues";
  uint64_t unpack_limit = 0;  ///< bytes that a packed model may unpack to; 0: the default of ModelReader
  bool quiet = false;
};

/// The parts of a run's time, for its progress; guesses from a plant of 12.5 million triangles on two cores.
struct StageShares {
  static constexpr double kReading = 0.15;
  double dividing = 0, smoothing = 0, building = 0, images = 0;

  /// Of a scene that has been read. `in_memory`: it is not divided. Images take about as long as 50,000
  /// triangles each.
  static StageShares Of(uint64_t triangles, size_t images, bool in_memory) {
    constexpr double kImage = 50e3;
    const double of_images = kImage * static_cast<double>(images);
    const double rest = 1 - kReading,
                 imaging = rest * of_images / (of_images + static_cast<double>(triangles));
    const double solid = rest - imaging;
    if (in_memory) return {0, 0, solid, imaging};
    return {0.12 * solid, 0.08 * solid, 0.8 * solid, imaging};
  }
};

/// The axis about which placements turn models: the scene's, z where it is guessed.
inline uint32_t PlacedAbout(const PreprocessOptions& options) {
  return options.up_axis != 0 ? options.up_axis : 2;
}

/// The placement of a model; the default if none is given.
Placement PlacementOf(const PreprocessOptions& options, const std::string& model);

/// A model's path without the suffix of a packed file.
std::string UnpackedPath(const std::string& model);

/// The models' file names as the store keeps them, without folders; none of standard input.
std::vector<std::string> ModelNamesOf(const PreprocessOptions& options);

/// How this run reads formats that Quarry has no reader for: by the program beside this one, if there is one.
/// `prefix`: of its files.
ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix);
/// How this run decodes compressed parts of glTF. `folder`: of decoded bytes.
GltfDecoding GltfDecodingOf(const PreprocessOptions& options, const std::string& folder);
/// How this run makes triangles of exact surfaces. `folder`: of copies of packed models.
CadReading CadReadingOf(const PreprocessOptions& options, const std::string& folder);
/// How this run decodes images.
ImageDecoding ImageDecodingOf(const PreprocessOptions& options);

/// The folder of a run's temporary files.
std::string SpillFolder(const PreprocessOptions& options);

}  // namespace quarry
