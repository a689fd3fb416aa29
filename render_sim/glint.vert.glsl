#version 330 core
// World position and normal of the surface, and its place on the body; matrices as pyrender binds them.

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;

out vec3 world_position;
out vec3 world_normal;
out vec3 body_position;

void main()
{
    vec4 world = M * vec4(position, 1.0);
    world_position = world.xyz;
    world_normal = mat3(M) * normal;  // a pose is rigid: no inverse transpose
    body_position = position;
    gl_Position = P * V * world;
}
