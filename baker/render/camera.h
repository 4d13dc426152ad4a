// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"
#include "baker/math/vector.h"
#include "baker/trace/tracer.h"

#include <optional>

namespace envbake {

/// A pinhole camera that holds +Y upright (and -Z when it looks straight up or down).
struct Camera {
    DVec3 position{0, 0, 1};  ///< world space, metres
    DVec3 target{0, 0, 0};    ///< the middle of the picture
    double vertical_fov_deg = 35;
    int width = 1280;  ///< pixels
    int height = 720;
};

/// The directions of a camera's pixels.
class CameraRays {
  public:
    explicit CameraRays(const Camera& camera);
    /// Unit; (0, 0) is the upper left corner of the picture, (width, height) the lower right.
    DVec3 towards(double x, double y) const;
    /// Where a world-space point appears; false when it is not in front of the camera.
    bool project(const DVec3& point, DVec2& pixel) const;

  private:
    DVec3 position_, forward_, right_, up_;
    double width_, height_, tan_x_, tan_y_;
};

/// A camera for a scene that nobody described: from the front right (35 degrees from +Z towards
/// +X) and 11 degrees above, as near as keeps every triangle inside the picture with a margin of
/// 4 %. A scene that is seen from its inner side from there (most of what the rays meet are back
/// faces that glTF hides) is a room: the camera then stands inside, where a horizontal line of
/// sight is longest, and looks along it. Without such a line of sight it stays outside.
/// `vertical_fov_deg`: degrees in (0, 180); default: 35 from outside, 55 in a room.
/// Deterministic. Cost: a pass over the vertices and a few thousand rays.
Camera frame_scene(const Scene& scene, const Tracer& tracer, int width, int height,
                   std::optional<double> vertical_fov_deg = {});

}  // namespace envbake
