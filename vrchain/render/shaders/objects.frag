#version 330 core
flat in vec3 id;
out vec4 colour;

void main()
{
    colour = vec4(id, 1.0);
}
