#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <vector>

#include "rig/sim/body_paint.h"
#include "rig/sim/body_shape.h"
#include "rig/sim/garment.h"
#include "rig/sim/obj_body.h"
#include "sfm/core/file_io.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector3f;

constexpr float kHeight_m = 1.80f;

TEST(ExtractSurface, SphereHasItsAreaAndIsClosed) {
  ThreadPool threads(2);
  SurfaceOptions options;
  options.low = Vector3f::Constant(-0.15f);
  options.high = Vector3f::Constant(0.15f);
  options.voxel_m = 0.005f;
  const Mesh mesh =
      ExtractSurface([](const Vector3f& p) { return p.norm() - 0.1f; }, options, threads);
  EXPECT_TRUE(IsClosedManifold(mesh));
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    EXPECT_NEAR(mesh.vertices[i].norm(), 0.1f, 1e-5f);
    EXPECT_GT(mesh.normals[i].dot(mesh.vertices[i].normalized()), 0.99f);
  }
}

TEST(ExtractSurface, SheetsThatNearlyTouchStayApart) {
  ThreadPool threads(1);
  SurfaceOptions options;
  options.low = Vector3f::Constant(-0.15f);
  options.high = Vector3f::Constant(0.15f);
  options.voxel_m = 0.007f;
  // Two balls whose gap is thinner than a cell, on a diagonal.
  const Vector3f centre = Vector3f(0.04f, 0.035f, 0.03f);
  const float radius = centre.norm() - 0.0015f;
  const Mesh mesh = ExtractSurface(
      [&](const Vector3f& p) {
        return std::min((p - centre).norm(), (p + centre).norm()) - radius;
      },
      options, threads);
  EXPECT_TRUE(IsClosedManifold(mesh));
}

TEST(Mesh, AMissingTriangleIsNotClosed) {
  Mesh mesh = MakeBox(Vector3f::Zero(), Eigen::Matrix3f::Identity(), Vector3f::Ones());
  EXPECT_FALSE(IsClosedManifold(mesh));  // sharp edges: faces share no vertices
}

class Body : public testing::TestWithParam<Relief> {};

TEST_P(Body, IsAClosedSurfaceOfTheHeightAskedFor) {
  ThreadPool threads(2);
  constexpr uint64_t kSeed = 11;
  const BodyShape shape(DrawProportions(kSeed), GetParam(), kHeight_m);
  const Mesh mesh = MakeBodyMesh(shape, 0.0035f, threads);
  EXPECT_TRUE(IsClosedManifold(mesh)) << "seed " << kSeed;
  // Genus 0 and one piece: V - E + F = 2.
  EXPECT_EQ(mesh.vertices.size(), 2 + mesh.triangles.size() / 2);
  float low = 9, high = 0;
  for (const Vector3f& p : mesh.vertices) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  EXPECT_NEAR(low, 0.0f, 0.003f);
  EXPECT_NEAR(high - low, kHeight_m, 0.02f);  // hair stands out by a centimetre or so
}

INSTANTIATE_TEST_SUITE_P(Reliefs, Body, testing::Values(Relief::kNatural, Relief::kSymmetric));

/// Largest difference of the surface function between front and back over the garment.
float AsymmetryOfGarment(const BodyShape& shape) {
  float worst = 0;
  int points = 0;
  for (float z = 0.15f; z < 1.45f; z += 0.01f) {
    for (float y = -0.5f; y < 0.5f; y += 0.01f) {
      for (float x = 0.01f; x < 0.2f; x += 0.005f) {
        const Vector3f p(x, y, z), q(-x, y, z);
        const bool garment =
            shape.layout().GarmentInside_m(p) > 0.01f && shape.layout().GarmentInside_m(q) > 0.01f;
        const float d = shape.Distance(p);
        if (!garment || std::abs(d) > 0.01f) continue;
        ++points;
        worst = std::max(worst, std::abs(d - shape.Distance(q)));
      }
    }
  }
  EXPECT_GT(points, 5000);
  return worst;
}

TEST(BodyShape, SymmetricReliefIsTheSameBehindAndNaturalIsNot) {
  const BodyProportions proportions = DrawProportions(3);
  EXPECT_LT(AsymmetryOfGarment(BodyShape(proportions, Relief::kSymmetric, 1.75f)), 1e-6f);
  EXPECT_GT(AsymmetryOfGarment(BodyShape(proportions, Relief::kNatural, 1.75f)), 0.01f);
}

TEST(BodyShape, HeadStaysIndividualWhenTheReliefIsSymmetric) {
  const BodyShape shape(DrawProportions(3), Relief::kSymmetric, 1.75f);
  // The nose's height: the face is further out than the back of the neck mirrored.
  EXPECT_GT(std::abs(shape.Distance({0.11f, 0, 1.60f}) - shape.Distance({-0.11f, 0, 1.60f})),
            0.005f);
}

Vector3f AlbedoAt(const Garment& garment, const Vector3f& p) {
  SurfacePoint point;
  point.position = p;
  point.footprint_m = 0.001f;
  return garment.Albedo(point);
}

/// Mean difference of colour between a point of the front and the one a viewer behind sees at the
/// same place.
float DifferenceOfSides(GarmentTexture texture) {
  const BodyShape shape(DrawProportions(3), Relief::kSymmetric, 1.75f);
  const Garment garment(texture, 5, shape.layout());
  float sum = 0;
  int count = 0;
  for (float z = 0.9f; z < 1.35f; z += 0.01f) {
    for (float y = -0.12f; y < 0.12f; y += 0.01f) {
      const Vector3f front = AlbedoAt(garment, {0.1f, y, z});
      sum += (front - AlbedoAt(garment, {-0.1f, -y, z})).norm();
      ++count;
    }
  }
  return sum / static_cast<float>(count);
}

TEST(Garment, TwinAndPlaidLookTheSameFromBehindAndUniqueDoesNot) {
  EXPECT_LT(DifferenceOfSides(GarmentTexture::kTwin), 1e-6f);
  EXPECT_LT(DifferenceOfSides(GarmentTexture::kPlaid), 1e-6f);
  EXPECT_GT(DifferenceOfSides(GarmentTexture::kUnique), 0.05f);
}

TEST(Garment, PanelIsUprightAndUnmirroredForBothViewers) {
  const BodyShape shape(DrawProportions(3), Relief::kNatural, 1.75f);
  // A viewer in front (at +x, looking to -x) has +y at the right; one behind has -y there.
  EXPECT_GT(ToPanel(shape.layout(), {0.1f, 0.05f, 1.2f}).at_m.x(), 0.03f);
  EXPECT_GT(ToPanel(shape.layout(), {-0.1f, -0.05f, 1.2f}).at_m.x(), 0.03f);
  EXPECT_GT(ToPanel(shape.layout(), {0.1f, 0.0f, 1.3f}).at_m.y(),
            ToPanel(shape.layout(), {0.1f, 0.0f, 1.2f}).at_m.y());
}

/// What a cover changes of a paint at the points of a mesh.
struct CoverChange {
  std::vector<Vector3f> head, feet, between;  // colours after the cover, where it changed them
  size_t hands_kept = 0;                      // points of bare hands with the colour they had
};

CoverChange ChangeBy(const Mesh& mesh, const BodyLayout& layout, const Paint& bare,
                     const Paint& covered) {
  CoverChange change;
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    SurfacePoint point;
    point.position = mesh.vertices[i];
    point.normal = mesh.normals[i];
    if (!mesh.uvs.empty()) point.uv = mesh.uvs[i];
    point.footprint_m = 0.001f;
    const Vector3f before = bare.Albedo(point), after = covered.Albedo(point);
    const float z = point.position.z();
    if (before == after) {
      const bool is_hand = std::abs(point.position.y()) > 0.3f;
      change.hands_kept += is_hand && layout.GarmentInside_m(point.position) < -0.02f;
      continue;
    }
    // The cloth's edges are a few centimetres wide.
    const bool is_head = z > layout.neck_z_m - 0.06f, is_foot = z < layout.ankle_z_m + 0.02f;
    (is_head ? change.head : is_foot ? change.feet : change.between).push_back(after);
  }
  return change;
}

void ExpectOneColour(const std::vector<Vector3f>& colours) {
  ASSERT_GT(colours.size(), 100u);
  for (const Vector3f& colour : colours) ASSERT_EQ(colour, colours[0]);
}

TEST(Cover, FaceAndShoesAreEachOfOneColourAndNothingElseChanges) {
  ThreadPool threads(2);
  const BodyShape shape(DrawProportions(3), Relief::kSymmetric, 1.75f);
  const Mesh mesh = MakeBodyMesh(shape, 0.007f, threads);
  const auto paint = [&](Cover cover) {
    return MakeBodyPaint(shape, Garment(GarmentTexture::kTwin, 5, shape.layout()), cover, 7);
  };
  const auto bare = paint(Cover::kNone), covered = paint(Cover::kHeadAndShoes);
  const CoverChange change = ChangeBy(mesh, shape.layout(), *bare, *covered);
  ExpectOneColour(change.head);
  ExpectOneColour(change.feet);
  EXPECT_TRUE(change.between.empty());
  EXPECT_GT(change.hands_kept, 100u);
  // The crown of the head is hair, the tip of the nose is not.
  SurfacePoint point;
  point.position = {-0.02f, 0, 1.75f};
  EXPECT_EQ(covered->Albedo(point), bare->Albedo(point));
  point.position = {0.10f, 0, 1.60f};
  EXPECT_EQ(covered->Albedo(point), change.head[0]);
  EXPECT_EQ(covered->Gloss(point), 0.0f);
}

std::filesystem::path SharedBody(const std::string& name) {
  const char* shared = std::getenv("ROTUNDA_SHARED");
  const std::filesystem::path folder =
      shared ? std::filesystem::path(shared)
             : std::filesystem::path(ROTUNDA_SOURCE_DIR) / ".." / "shared";
  return folder / "data" / "bodies" / name / (name + ".obj");
}

TEST(ObjBody, StandsOnTheFloorFacingTheFront) {
  const std::filesystem::path file = SharedBody("White_M_2_Casual");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  const auto body = ReadObjBody(file, kHeight_m);
  ASSERT_TRUE(body) << body.error().ToString();
  Vector3f low = Vector3f::Constant(9), high = -low;
  float toes = 0;
  for (const Vector3f& p : body->mesh.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
    if (p.z() < 0.05f) toes = std::max(toes, p.x());
  }
  EXPECT_NEAR(low.z(), 0.0f, 1e-4f);
  EXPECT_NEAR(high.z(), kHeight_m, 1e-4f);
  EXPECT_NEAR(low.y(), -high.y(), 0.01f);
  EXPECT_GT(toes, 0.12f);
  EXPECT_LT(high.y(), 0.72f) << "the arms of a T-pose are lowered";
  ASSERT_FALSE(body->mesh.materials.empty());
  EXPECT_EQ(body->textures[body->mesh.materials[0]].width(), 2048);
}

TEST(ObjBody, CoverLeavesHairAndHands) {
  const std::filesystem::path file = SharedBody("Asian_F_2_Default");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  const auto paint = [&](ObjBody body, Cover cover) {
    auto garment = std::make_unique<Garment>(GarmentTexture::kTwin, 5, body.layout);
    return MakeObjPaint(std::move(body), std::move(garment), cover);
  };
  const ObjBody body = ReadObjBody(file, kHeight_m).value();
  const auto bare = paint(ReadObjBody(file, kHeight_m).value(), Cover::kNone);
  const auto covered = paint(ReadObjBody(file, kHeight_m).value(), Cover::kHeadAndShoes);
  const CoverChange change = ChangeBy(body.mesh, body.layout, *bare, *covered);
  ExpectOneColour(change.head);
  ExpectOneColour(change.feet);
  EXPECT_TRUE(change.between.empty());
  EXPECT_GT(change.hands_kept, 100u);
  SurfacePoint point;
  point.position = {0, 0, kHeight_m - 0.05f};
  const auto hair = std::find(body.is_hair.begin(), body.is_hair.end(), true);
  ASSERT_NE(hair, body.is_hair.end());
  point.material = static_cast<uint8_t>(hair - body.is_hair.begin());
  EXPECT_EQ(covered->Albedo(point), bare->Albedo(point));
}

TEST(ObjBody, MissingFileAndNotAMeshAreErrors) {
  EXPECT_EQ(ReadObjBody("/nonexistent.obj", 1.7f).error().code, ErrorCode::kNotFound);
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "not_a_mesh.obj";
  std::fclose(std::fopen(file.c_str(), "w"));
  EXPECT_EQ(ReadObjBody(file, 1.7f).error().code, ErrorCode::kBadInput);
  const std::string too_long(300, 'a');  // for a file name
  EXPECT_EQ(ReadObjBody(too_long, 1.7f).error().code, ErrorCode::kIo);
}

TEST(ObjBody, AMeshWithoutHeightIsRefused) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "flat.obj";
  ASSERT_TRUE(WriteFileAtomically(file, "v 0 2 5\nv 1 2 5\nv 3 2 5\nf 1 2 3\n"));
  const auto body = ReadObjBody(file, 1.7f);
  ASSERT_FALSE(body);
  EXPECT_EQ(body.error().code, ErrorCode::kBadInput);
  EXPECT_EQ(body.error().context, file.string());
  EXPECT_NE(body.error().message.find("is flat"), std::string::npos) << body.error().message;
}

}  // namespace
}  // namespace rotunda::sim
