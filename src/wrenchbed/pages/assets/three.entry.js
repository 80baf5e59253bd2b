export {AxesHelper, Box3, BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DirectionalLight, GridHelper, Group, HemisphereLight, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Raycaster, Scene, Sphere, Spherical, Vector2, Vector3, WebGLRenderer} from "three";
export {OrbitControls} from "three/addons/controls/OrbitControls.js";
export {toCreasedNormals} from "three/addons/utils/BufferGeometryUtils.js";
