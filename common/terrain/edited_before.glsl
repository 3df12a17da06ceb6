// Stands before a terrain's text that edited.glsl follows.
#define terrainHeight ownTerrainHeight
#define terrainColor ownTerrainColor
#define rasterWeights ownRasterWeights
#define rasterRow ownRasterRow
#define rasterCubic ownRasterCubic
