#include "config/board_config.h"

#include <gtest/gtest.h>

namespace rotunda::config {
namespace {

const std::filesystem::path kConfig = std::filesystem::path(ROTUNDA_SOURCE_DIR) / "config";

TEST(BoardConfig, ShippedCuboidHoldsTheDefaults) {
  const auto cuboid = ReadBoard(kConfig / "cuboid.toml");
  ASSERT_TRUE(cuboid) << cuboid.error().ToString();
  const rig::Board defaults = rig::CuboidBoard({});
  ASSERT_EQ(cuboid->faces.size(), defaults.faces.size());
  for (size_t f = 0; f < defaults.faces.size(); ++f) {
    const rig::BoardFace &a = cuboid->faces[f], &b = defaults.faces[f];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.columns, b.columns);
    EXPECT_EQ(a.rows, b.rows);
    EXPECT_EQ(a.first_id, b.first_id);
    EXPECT_EQ(a.dictionary, b.dictionary);
    EXPECT_NEAR(a.square_m, b.square_m, 1e-15);
    EXPECT_NEAR(a.marker_m, b.marker_m, 1e-15);
    EXPECT_NEAR(a.margin_m, b.margin_m, 1e-15);
    EXPECT_LT((a.board_from_face.Matrix() - b.board_from_face.Matrix()).norm(), 1e-12);
  }
  EXPECT_NEAR(cuboid->bow_sigma_m, defaults.bow_sigma_m, 1e-15);
  EXPECT_EQ(cuboid->rig_frame.shot, defaults.rig_frame.shot);
  EXPECT_EQ(cuboid->rig_frame.board_origin_m, defaults.rig_frame.board_origin_m);
  EXPECT_EQ(cuboid->rig_frame.front_rad, defaults.rig_frame.front_rad);
  EXPECT_NEAR(cuboid->face_position_sigma_m, defaults.face_position_sigma_m, 1e-15);
}

TEST(BoardConfig, AFileThatSaysNothingIsTheShippedCuboid) {
  const auto cuboid = ReadBoard(kConfig / "cuboid.toml"), empty = ParseBoard("", "empty");
  ASSERT_TRUE(cuboid && empty);
  ASSERT_EQ(empty->faces.size(), cuboid->faces.size());
  for (size_t f = 0; f < empty->faces.size(); ++f) {
    const rig::BoardFace &a = empty->faces[f], &b = cuboid->faces[f];
    EXPECT_EQ(a.square_m, b.square_m);
    EXPECT_EQ(a.marker_m, b.marker_m);
    EXPECT_EQ(a.margin_m, b.margin_m);
    EXPECT_EQ(a.first_id, b.first_id);
    EXPECT_EQ(a.dictionary, b.dictionary);
    EXPECT_EQ(a.board_from_face.Matrix(), b.board_from_face.Matrix());
  }
  EXPECT_EQ(empty->face_position_sigma_m, cuboid->face_position_sigma_m);
  EXPECT_EQ(empty->face_rotation_sigma_rad, cuboid->face_rotation_sigma_rad);
  EXPECT_EQ(empty->bow_sigma_m, cuboid->bow_sigma_m);
}

TEST(BoardConfig, TheRigFrameIsRead) {
  const auto board = ParseBoard(
      "[rig_frame]\nshot = \"placement_03\"\nboard_origin_mm = [10, 0, -5]\nfront_deg = 90\n",
      "a file");
  ASSERT_TRUE(board) << board.error().ToString();
  EXPECT_EQ(board->rig_frame.shot, "placement_03");
  EXPECT_LT((board->rig_frame.board_origin_m - Eigen::Vector3d(0.01, 0, -0.005)).norm(), 1e-15);
  EXPECT_NEAR(board->rig_frame.front_rad, kPi / 2, 1e-15);
}

TEST(BoardConfig, EveryShippedBoardIsAccepted) {
  int boards = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kConfig / "boards")) {
    const auto board = ReadBoard(entry.path());
    EXPECT_TRUE(board) << board.error().ToString();
    ++boards;
  }
  EXPECT_EQ(boards, 2);
}

TEST(BoardConfig, FacesTakeTheBoardsValuesAndTheirPlaces) {
  const auto board = ParseBoard(
      "[[face]]\nname='a'\ncolumns=5\nrows=7\norigin_mm=[10,0,0]\nright=[0,2,0]\ndown=[0,0,-1]\n"
      "[[face]]\nname='b'\ncolumns=5\nrows=4\nlegacy_pattern=true\nfirst_id=17\nsquare_mm=12\n"
      "marker_mm=9\n"
      "[board]\ndictionary='5X5_100'\nsquare_mm=20\nmarker_mm=15\n",
      "b.toml");
  ASSERT_TRUE(board) << board.error().ToString();
  ASSERT_EQ(board->faces.size(), 2u);
  const rig::BoardFace& a = board->faces[0];
  EXPECT_EQ(a.dictionary, "5X5_100");
  EXPECT_NEAR(a.square_m, 0.020, 1e-15);
  EXPECT_NEAR(board->faces[1].square_m, 0.012, 1e-15);
  EXPECT_LT(
      (a.board_from_face * Eigen::Vector3d(0.02, 0.04, 0) - Eigen::Vector3d(0.01, 0.02, -0.04))
          .norm(),
      1e-12);
}

struct BadText {
  const char* text;
  const char* where;
  const char* says;
};

class BadBoard : public testing::TestWithParam<BadText> {};

TEST_P(BadBoard, IsRefusedWithFileLineKeyAndWhatIsAllowed) {
  const auto board = ParseBoard(GetParam().text, "my.toml");
  ASSERT_FALSE(board);
  EXPECT_EQ(board.error().code, ErrorCode::kBadInput);
  EXPECT_EQ(board.error().context, GetParam().where);
  EXPECT_NE(board.error().message.find(GetParam().says), std::string::npos)
      << board.error().message;
}

INSTANTIATE_TEST_SUITE_P(
    BoardConfig, BadBoard,
    testing::Values(
        BadText{"[cuboid]\nrows = 24\n", "my.toml:2: cuboid.rows", "an odd number from 3"},
        BadText{"[cuboid]\nrows = 45\ncolumns = 9\n", "my.toml: face[2].first_id", "0 to 385"},
        BadText{"[cuboid]\ntop = 1\n", "my.toml:2: cuboid.top", "expected true or false"},
        BadText{"[cuboid]\n[[face]]\nname='a'\n", "my.toml:1: cuboid", "expected one of them"},
        BadText{"[board]\nsquare_mm = 0\n[[face]]\nname='a'\ncolumns=3\nrows=3\n",
                "my.toml:2: board.square_mm", "is 0, allowed is 0.1"},
        BadText{"[board]\nmarker_mm = 99\n", "my.toml:2: board.marker_mm", "is 99, allowed is 0.3"},
        BadText{"[board]\nsquare_mm = 60\n[[face]]\nname='a'\ncolumns=3\nrows=3\nsquare_mm=0\n",
                "my.toml:7: face[0].square_mm", "is 0, allowed is 0.1"},
        BadText{"[rig_frame]\nfront_deg = inf\n", "my.toml:2: rig_frame.front_deg",
                "is inf, allowed is a finite number"},
        BadText{"[rig_frame]\nboard_origin_mm = [0, nan, 0]\n",
                "my.toml:2: rig_frame.board_origin_mm", "three finite numbers"},
        BadText{"[cuboid]\nrows = [25]\n", "my.toml:2: cuboid.rows",
                "is an array, expected an integer"},
        BadText{"[[face]]\nname='a'\ncolumns=3\nrows=4\n", "my.toml:1: face[0].legacy_pattern",
                "is missing"},
        BadText{"[[face]]\nname='a'\ncolumns=3\nrows=3\ndictionary='8X8'\n",
                "my.toml:5: face[0].dictionary", "is '8X8', allowed are 4X4_50,"},
        BadText{"[[face]]\nname='a'\ncolumns=3\nrows=3\n[[face]]\nname='b'\ncolumns=3\nrows=3\n"
                "first_id=3\n",
                "my.toml:9: face[1].first_id", "leaves the ids 0 to 3 to face 'a'"},
        BadText{"[[face]]\nname='a'\ncolumns=3\nrows=3\ndown=[1,0.1,0]\n",
                "my.toml:1: face[0].right", "right angle"},
        BadText{"[[face]]\nname='a'\ncolumns=3\nrows=3\ndown=[1,0]\n", "my.toml:5: face[0].down",
                "three numbers"},
        BadText{"[[face]]\ncolumns=3\nrows=3\n", "my.toml:1: face[0].name", "is empty"},
        BadText{"[[face]]\nname=3\n", "my.toml:2: face[0].name", "expected a string"},
        BadText{"[[faces]]\nname='a'\n", "my.toml:1: faces[0]", "allowed are the tables board"}));

TEST(BoardConfig, EverythingThatIsWrongIsNamedOnce) {
  const auto texts = [](const std::string& file) {
    std::vector<std::string> texts;
    for (const Error& problem : CheckBoard(file, "b.toml").problems) {
      texts.push_back(problem.ToString());
    }
    return texts;
  };
  EXPECT_EQ(texts("[board]\nsquare_mm = 0\nbow_sigma_mm = -1\ncolour = 3\n"
                  "[cuboid]\nrows = 7\ntop = 1\n"),
            (std::vector<std::string>{
                "b.toml:4: board.colour: is not known; allowed are name, dictionary, square_mm, "
                "marker_mm, margin_mm, face_position_sigma_mm, face_rotation_sigma_deg, "
                "bow_sigma_mm",
                "b.toml:7: cuboid.top: is an integer, expected true or false",
                "b.toml:2: board.square_mm: is 0, allowed is 0.1 to 10000",
                "b.toml:3: board.bow_sigma_mm: is -1, allowed is 0 or more"}));
  EXPECT_EQ(texts("[cuboid]\nrows = 4\ncolumns = 'x'\n").size(), 2u);
  EXPECT_EQ(texts("[cuboid]\nrows = 4\ncolumns = 100\n").size(), 2u);
  EXPECT_EQ(texts("[[face]]\nname='a'\ncolumns=3\nrows=1\nright=[0,0,0]\n"
                  "[[face]]\nname='a'\ncolumns=2000000000\nrows=2000000000\nlegacy_pattern=true\n"
                  "[[face]]\nname='c'\ncolumns=3\nrows=3\nfirst_id=-1\nmarker_mm=0\n"),
            (std::vector<std::string>{
                "b.toml:5: face[0].right: and down must be two directions, found one of no length",
                "b.toml:4: face[0].rows: is 1, allowed is 2 to 200",
                "b.toml:7: face[1].name: is 'a', allowed is what no other face is called",
                "b.toml:8: face[1].columns: is 2000000000, allowed is 2 to 200",
                "b.toml:9: face[1].rows: is 2000000000, allowed is 2 to 200",
                "b.toml:16: face[2].marker_mm: is 0, allowed is 0.3 to 0.95 of square_mm",
                "b.toml:15: face[2].first_id: is -1, allowed is 0 to 583, so that the face's 4 ids "
                "are in APRILTAG_36h11"}));
}

}  // namespace
}  // namespace rotunda::config
